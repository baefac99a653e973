// SPDX-License-Identifier: BSD-3-Clause
#include <unistd.h>

#include <cstdio>

#include "firmware/box_options.h"
#include "firmware/calibration_table.h"
#include "firmware/commands.h"
#include "firmware/export.h"
#include "firmware/input_error.h"
#include "firmware/text_file.h"

namespace throwcal {
namespace {

using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;

std::string text_or(const Json& object, const char* key, const std::string& otherwise) {
  return object.contains(key) && object[key].is_string() ? object[key].get<std::string>()
                                                         : otherwise;
}

/// One line: what the box does now.
std::string status_line(const Json& status) {
  std::string line = status.at("state").get<std::string>() + ": " +
                     std::to_string(status.at("throws").get<int>()) + " throws";
  if (status.at("worst_sigma_position_m").is_number()) {
    char sigma[64];
    std::snprintf(sigma, sizeof sigma, ", worst sigma %.2f mm %.2f mrad",
                  1e3 * status.at("worst_sigma_position_m").get<double>(),
                  1e3 * status.at("worst_sigma_rotation_rad").get<double>());
    line += sigma;
  }
  if (const auto verdict = text_or(status, "verdict", ""); !verdict.empty()) line += ", " + verdict;
  return line;
}

std::string status_text(const Json& status) {
  std::string out = status_line(status) + "\n";
  if (const auto advice = text_or(status, "advice", ""); !advice.empty())
    out += "  " + advice + "\n";
  for (const Json& camera : status.at("cameras")) {
    char line[160];
    std::snprintf(line, sizeof line, "  %-12s %6.1f frames/s  %8lld frames  %lld lost  %d flights",
                  camera.at("name").get<std::string>().c_str(),
                  camera.at("frames_per_s").get<double>(), camera.at("frames").get<long long>(),
                  camera.at("frames_lost_by_driver").get<long long>() +
                      camera.at("frames_damaged").get<long long>() +
                      camera.at("frames_dropped").get<long long>(),
                  camera.at("flights").get<int>());
    out += line;
    if (const auto error = text_or(camera, "error", ""); !error.empty()) out += "  " + error;
    out += '\n';
  }
  return out;
}

/// What CAN tells of a box: fewer words, and the poses themselves.
std::string can_status_text(const Json& status) {
  std::string out =
      status_line(status) + "\n  " + status.at("cameras_running").dump() + " of " +
      status.at("cameras").dump() + " cameras run, " + status.at("frames_lost").dump() +
      " frames lost, " + status.at("frames_dropped").dump() + " dropped, up " +
      status.at("uptime_s").dump() + " s, " + status.at("software").get<std::string>() + "\n";
  if (status.at("fault") == true) out += "  a fault: throwcal status --host tells which\n";
  if (status.at("calibration_problem") == true)
    out += "  the last calibration is not of these cameras\n";
  for (const Json& pose : status.at("poses")) {
    out += "  camera " + pose.at("camera").dump() + ": ";
    if (!pose.at("translation_m").is_array() || !pose.at("rotation_vector_rad").is_array()) {
      out += "not known\n";
      continue;
    }
    const auto t = pose.at("translation_m").get<std::vector<double>>(),
               r = pose.at("rotation_vector_rad").get<std::vector<double>>();
    char line[160];
    std::snprintf(line, sizeof line, "%.4f %.4f %.4f m, rotation vector %.6f %.6f %.6f rad%s\n",
                  t[0], t[1], t[2], r[0], r[1], r[2],
                  pose.at("clamped") == true ? " (some number does not fit CAN)" : "");
    out += line;
  }
  return out;
}

void print(const Json& value, const std::string& text, bool json) {
  const std::string out = json ? value.dump(2) + "\n" : text;
  std::fputs(out.c_str(), stdout);
}

/// Shows one status after the other, on a terminal over the last one, elsewhere a line a change.
class LiveLine {
 public:
  explicit LiveLine(bool json) : json_(json), on_terminal_(!json && isatty(STDOUT_FILENO) == 1) {}
  ~LiveLine() {
    if (on_terminal_ && !last_.empty()) std::putchar('\n');
  }
  LiveLine(const LiveLine&) = delete;
  LiveLine& operator=(const LiveLine&) = delete;

  void show(const Json& status) {
    const std::string line = json_ ? status.dump() : status_line(status);
    if (line == last_) return;
    last_ = line;
    std::printf(on_terminal_ ? "\r\033[K%s" : "%s\n", line.c_str());
    std::fflush(stdout);
  }

 private:
  bool json_, on_terminal_;
  std::string last_;
};

/// Follows the box's status until `enough` says so; false when the time is up.
template <typename Enough>
bool follow(BoxClient& box, LiveLine& line, double timeout_s, const Enough& enough) {
  const auto deadline = Clock::now() + std::chrono::duration<double>(timeout_s);
  Json status = box.call("status.subscribe");
  for (;;) {
    line.show(status);
    if (enough(status)) return true;
    const auto left = deadline - Clock::now();
    if (timeout_s > 0 && left <= 0s) return false;
    const auto wait = timeout_s > 0 ? std::min<Clock::duration>(
                                          std::chrono::duration_cast<Clock::duration>(left), 1s)
                                    : 1s;
    if (auto next = box.notification(std::chrono::ceil<std::chrono::milliseconds>(wait)))
      status = std::move(*next);
  }
}

CLI::App* add_status(CLI::App& app, int& status, const std::shared_ptr<BoxOptions>& box) {
  auto* command = app.add_subcommand("status", "What the box does now");
  command->footer("Example:\n  throwcal status --host box.local\n  throwcal status --can can0");
  command->callback([box, &status] {
    status = exit_accepted;
    if (!box->can.empty()) {
      const Json now = box->listen().status();
      return print(now, can_status_text(now), box->json);
    }
    BoxClient client = box->connect();
    const Json now = client.call("status.get");
    print(now, status_text(now), box->json);
  });
  return command;
}

void start_capture(const BoxOptions& options, bool until_stopped) {
  BoxClient box = options.connect();
  options.authenticate(box);
  const Json now = box.call("capture.start", {{"until", until_stopped ? "stopped" : "target"}});
  print(now, "capturing, session " + now.at("session").dump() + ": throw the ball\n", options.json);
}

void start_capture_by_can(const BoxOptions& options) {
  const CanAck ack = options.listen().order(CanOrder::start, options.short_key());
  const Json now{{"state", can_state_word(ack.state)}, {"session", ack.session}};
  print(now, "capturing, session " + now.at("session").dump() + ": throw the ball\n", options.json);
}

void stop_capture_by_can(const BoxOptions& options, double timeout_s, bool wait) {
  CanClient box = options.listen();
  box.order(CanOrder::stop, options.short_key());
  Json now = box.status();
  const auto deadline = Clock::now() + std::chrono::duration<double>(timeout_s);
  while (wait && now.at("state") == "solving") {
    if (Clock::now() > deadline)
      throw BoxError("the box is still solving after " + shortest(timeout_s) + " s");
    now = box.status();
  }
  print(now, status_line(now) + "\n", options.json);
}

void stop_capture(const BoxOptions& options, double timeout_s, bool wait) {
  BoxClient box = options.connect();
  options.authenticate(box);
  Json now = box.call("capture.stop");
  const Json session = now.at("session");
  if (wait) {
    LiveLine quiet(true);
    const auto deadline = Clock::now() + std::chrono::duration<double>(timeout_s);
    now = box.call("status.subscribe");
    while (now.at("state") == "solving" && now.at("session") == session) {
      if (Clock::now() > deadline)
        throw BoxError("the box is still solving after " + shortest(timeout_s) + " s");
      if (auto next = box.notification(1s)) now = std::move(*next);
    }
  }
  print(now, status_line(now) + "\n", options.json);
}

void abort_capture_by_can(const BoxOptions& options) {
  CanClient box = options.listen();
  box.order(CanOrder::abort, options.short_key());
  const Json now = box.status();
  print(now, status_line(now) + "\n", options.json);
}

void abort_capture(const BoxOptions& options) {
  BoxClient box = options.connect();
  options.authenticate(box);
  const Json now = box.call("capture.abort");
  print(now, status_line(now) + "\n", options.json);
}

CLI::App* add_capture(CLI::App& app, int& status, const std::shared_ptr<BoxOptions>& box) {
  auto* capture = app.add_subcommand("capture", "Start or stop a session of throws");
  capture->require_subcommand(1);
  capture->footer(
      "Example:\n  throwcal capture start && throwcal watch --until-throws 5 && throwcal capture "
      "stop && throwcal fetch");
  auto* start = capture->add_subcommand("start", "From now on, throws count");
  auto until_stopped = std::make_shared<bool>(false);
  start->add_flag("--until-stopped", *until_stopped,
                  "Go on though the rig file's [target] is reached");
  start->callback([box, until_stopped, &status] {
    box->can.empty() ? start_capture(*box, *until_stopped) : start_capture_by_can(*box);
    status = exit_accepted;
  });
  auto* stop = capture->add_subcommand("stop", "No more throws; solve, and wait for the result");
  auto timeout_s = std::make_shared<double>(120.0);
  auto no_wait = std::make_shared<bool>(false);
  stop->add_option("--timeout", *timeout_s, "How long to wait for the result [s]")
      ->capture_default_str();
  stop->add_flag("--no-wait", *no_wait, "Return as soon as the box has taken note");
  stop->callback([box, timeout_s, no_wait, &status] {
    if (box->can.empty())
      stop_capture(*box, *timeout_s, !*no_wait);
    else
      stop_capture_by_can(*box, *timeout_s, !*no_wait);
    status = exit_accepted;
  });
  auto* abort = capture->add_subcommand("abort", "Throw this session away");
  abort->callback([box, &status] {
    box->can.empty() ? abort_capture(*box) : abort_capture_by_can(*box);
    status = exit_accepted;
  });
  return capture;
}

CLI::App* add_fetch(CLI::App& app, int& status, const std::shared_ptr<BoxOptions>& box) {
  auto* command = app.add_subcommand("fetch", "Get the latest calibration");
  auto output = std::make_shared<std::string>();
  auto truth = std::make_shared<std::string>();
  command->add_option("--output", *output, "Where it goes (JSON)");
  command->add_option("--truth", *truth, "A truth file of throwcal simulate to compare with");
  command->footer(
      "Example:\n  throwcal fetch --output calibration.json\n"
      "  throwcal fetch --can can0 --output calibration.json\n"
      "Exit status: 0 accepted; 3 the verdict is another; 1 no box, or it has no calibration.");
  command->callback([box, output, truth, &status] {
    std::optional<Calibration> true_rig;
    if (!truth->empty()) true_rig = to_calibration(read_json(*truth), *truth);
    const Json document = box->latest_calibration();
    const Calibration calibration = to_calibration(document, "the box's calibration");
    if (!output->empty()) write_text_file(*output, document.dump(2) + "\n");
    print(document, calibration_table(calibration, true_rig), box->json);
    status = calibration.verdict == Verdict::accepted ? exit_accepted : exit_not_accepted;
  });
  return command;
}

CLI::App* add_watch(CLI::App& app, int& status, const std::shared_ptr<BoxOptions>& box) {
  auto* command = app.add_subcommand("watch", "Follow what the box does");
  auto throws = std::make_shared<int>(0);
  auto timeout_s = std::make_shared<double>(0.0);
  command->add_option("--until-throws", *throws,
                      "Return once that many throws are found, or the session has ended");
  command->add_option("--timeout", *timeout_s, "Give up after so many seconds (exit status 1)");
  command->footer("Example:\n  throwcal watch --until-throws 5 --timeout 60");
  command->callback([box, throws, timeout_s, &status] {
    BoxClient client = box->connect();
    LiveLine line(box->json);
    const bool reached = follow(client, line, *timeout_s, [&](const Json& now) {
      const bool is_over = now.at("state") == "done" || now.at("state") == "fault";
      return *throws > 0 && (now.at("throws").get<int>() >= *throws || is_over);
    });
    status = reached ? exit_accepted : exit_failed;
    if (!reached && *throws > 0)
      throw BoxError("after " + shortest(*timeout_s) + " s there were fewer than " +
                     std::to_string(*throws) + " throws");
  });
  return command;
}

}  // namespace

void add_box_commands(CLI::App& app, int& status) {
  auto box = std::make_shared<BoxOptions>();
  const auto with_box = [&](CLI::App* command) {
    box->add_to(*command);
    return command;
  };
  const auto with_can = [&](CLI::App* command) {
    box->add_can_to(*command);
    return command;
  };
  with_can(&app);
  with_box(with_can(add_status(app, status, box)));
  CLI::App* capture = add_capture(app, status, box);
  for (CLI::App* command : capture->get_subcommands({})) {
    with_box(with_can(command));
    box->add_token_to(*command);
  }
  with_box(with_can(add_fetch(app, status, box)));
  with_box(add_watch(app, status, box));
  add_session_commands(app, status, box);
}

}  // namespace throwcal
