// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/daemon.h"
#include "firmware/input_error.h"

namespace throwcal {
namespace {

constexpr std::chrono::seconds late_press{2};

}  // namespace

std::filesystem::path Daemon::token_file() const {
  return config_.token_file.value_or(settings_.state_dir / "token");
}

/// Who can press the button stands at the box; so for a while anybody may change something.
bool Daemon::obey(Press press) {
  access_.button_pressed(Access::Clock::now());
  try {
    if (press == Press::factory_reset)
      reset_access();
    else if (press == Press::abort)
      abort_capture();
    else if (session_.is_watching())
      stop_capture();
    else if (std::chrono::steady_clock::now() < ended_itself_ + late_press)
      log_info("button: the session had just ended by itself");  // whoever pressed meant that one
    else
      start_capture();
    return true;
  } catch (const RpcError& refused) {
    log_info(std::string("button: ") + refused.what());
  } catch (const InputError& error) {
    log_error(std::string("button: ") + error.what());
  }
  return false;
}

/// Sessions and calibrations stay: they are somebody's work.
void Daemon::reset_access() {
  access_.renew(new_token_in(token_file()));
  link_.forget_tokens();
  if (can_) can_->set_key(access_.short_key());
  log_info(Happening::new_token,
           "button: held since the start; there is a new token in " + token_file().string());
}

}  // namespace throwcal
