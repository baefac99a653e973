// SPDX-License-Identifier: BSD-3-Clause
#include <CLI/CLI.hpp>
#include <csignal>
#include <cstdio>

#include "firmware/cameras.h"
#include "firmware/config_check.h"
#include "firmware/daemon.h"
#include "firmware/input_error.h"

namespace {

/// Before any thread is made: signals come through the main loop, a client's death through send().
void prepare_signals() {
  sigset_t handled;
  sigemptyset(&handled);
  sigaddset(&handled, SIGTERM);
  sigaddset(&handled, SIGINT);
  sigaddset(&handled, SIGHUP);
  pthread_sigmask(SIG_BLOCK, &handled, nullptr);
  std::signal(SIGPIPE, SIG_IGN);
}

std::filesystem::path state_dir(const std::string& option, const throwcal::Config& config) {
  const char* from_systemd = std::getenv("STATE_DIRECTORY");
  if (!option.empty()) return option;
  if (config.state_dir) return *config.state_dir;
  return from_systemd ? from_systemd : "/var/lib/throwcal";
}

std::optional<throwcal::ListenAddress> http_address(const std::string& option) {
  if (option == "off") return {};
  const auto address = throwcal::parse_address(option, throwcal::HttpSettings{}.listen->port);
  if (address) return address;
  throw throwcal::InputError("--http-listen " + option + ": expected ADDRESS, ADDRESS:PORT or off");
}

}  // namespace

int main(int argc, char** argv) {
  using namespace throwcal;
  silence_video_libraries();
  CLI::App app("throwcald: watches thrown balls and calibrates the cameras.", "throwcald");
  std::string config_file, listen, http_listen, state, port_file, http_port_file;
  app.set_version_flag("--version", "throwcal " THROWCAL_VERSION);
  app.add_option("--config", config_file, "The rig file (TOML)");
  bool show_states = false;
  app.add_flag("--states", show_states, "Print what every event does in every state, and leave");
  app.add_option("--listen", listen, "ADDRESS:PORT, in place of the rig file's; port 0: any");
  app.add_option("--http-listen", http_listen,
                 "Likewise for HTTP; \"off\": none; default: the rig file's, or 0.0.0.0:8080");
  app.add_option("--state-dir", state, "Where sessions and calibrations are kept");
  app.add_option("--port-file", port_file, "A file that gets the port once it is open");
  bool only_check = false;
  app.add_flag("--check", only_check, "Say what is understood of the rig file, and end");
  app.add_option("--http-port-file", http_port_file, "Likewise for HTTP's port");
  prepare_signals();
  try {
    app.parse(argc, argv);
    if (show_states) {
      std::fputs(session_table().c_str(), stdout);
      return 0;
    }
    if (config_file.empty()) throw InputError("--config is missing: expected the rig file");
    Config config = read_config(config_file);
    assume_detector_errors(config.rig);
    for (const std::string& warning : config.warnings) log_warning(warning);
    if (!listen.empty()) {
      const auto address = parse_address(listen, config.listen.port);
      if (!address) throw InputError("--listen " + listen + ": expected ADDRESS or ADDRESS:PORT");
      config.listen = *address;
    }
    if (!http_listen.empty()) config.http.listen = http_address(http_listen);
    const std::filesystem::path folder = state_dir(state, config);
    if (only_check) {
      std::printf("%s%s: ok\n", summary(config, folder).c_str(), config_file.c_str());
      return 0;
    }
    Daemon(config, {config_file, folder, port_file, http_port_file}).run();
    return 0;
  } catch (const CLI::Success& asked_for_help) {
    return app.exit(asked_for_help);
  } catch (const std::exception& error) {
    log_error(error.what());
    return 2;
  }
}
