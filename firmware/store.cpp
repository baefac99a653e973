// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/store.h"

#include <fcntl.h>
#include <sys/file.h>
#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <cstdio>
#include <cstring>
#include <utility>

#include "firmware/input_error.h"
#include "firmware/text_file.h"

namespace throwcal {
namespace {

/// A calibration's id is its session's number and its own.
constexpr std::int64_t ids_per_session = 10'000;
/// Deleting needs a little room, which a full disk has not: this file has kept it.
constexpr std::size_t reserve_bytes = 256 * 1024;
/// With less than this, the disk is as good as full: a calibration and its log need it.
constexpr std::uintmax_t least_free_bytes = 512 * 1024;
constexpr const char* extension = ".throwcal";
constexpr int used_by_another = -2;  // in place of the lock's descriptor

std::string name_of(std::int64_t id) {
  char name[32];
  std::snprintf(name, sizeof name, "%06lld%s", static_cast<long long>(id), extension);
  return name;
}

std::optional<std::int64_t> id_of(const std::filesystem::path& file) {
  const std::string stem = file.stem().string();
  std::int64_t id = 0;
  const auto [end, error] = std::from_chars(stem.data(), stem.data() + stem.size(), id);
  if (file.extension() != extension || error != std::errc{} || end != stem.data() + stem.size() ||
      id <= 0 || id > 1'000'000'000)
    return {};
  return id;
}

/// What lies beside a file that was left in the middle of a write.
std::vector<std::filesystem::path> logs_of(const std::filesystem::path& file) {
  return {file.string() + "-wal", file.string() + "-journal"};
}

bool was_cut(const std::filesystem::path& file) {
  return std::ranges::any_of(logs_of(file), [](const auto& log) {
    std::error_code none;
    return std::filesystem::exists(log, none);
  });
}

StoreError unusable(const std::filesystem::path& place, const std::string& why) {
  return StoreError(place.string() + ": can't be used: " + why +
                    "; expected a folder that this user may write to");
}

bool is_over(const SessionFacts& facts) {
  return facts.state == "done" || facts.state == "aborted";
}

}  // namespace

Store::Store(std::filesystem::path state_dir, StoreSettings settings)
    : state_dir_(std::move(state_dir)), folder_(state_dir_ / "sessions"), settings_(settings) {
  try {
    ready();
  } catch (const StoreError&) {
    if (lock_ == used_by_another) throw;
  }
}

Store::~Store() {
  if (current_) seal(*current_);
  current_.reset();
  if (lock_ >= 0) close(lock_);
}

void Store::take_lock() {
  std::error_code error;
  std::filesystem::create_directories(folder_, error);
  if (error) throw unusable(state_dir_, error.message());
  const int fd = open((state_dir_ / "lock").c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0640);
  if (fd < 0) throw unusable(state_dir_, std::strerror(errno));
  if (flock(fd, LOCK_EX | LOCK_NB) != 0) {
    close(fd);
    lock_ = used_by_another;
    throw StoreError(state_dir_.string() + ": another throwcald is using it");
  }
  lock_ = fd;
}

/// What is there can be read though nothing can be written.
void Store::ready() {
  const bool was_ready = std::exchange(is_ready_, false);
  if (!is_read_) read_folder();
  if (lock_ < 0) {
    take_lock();
    read_folder();  // now with what only a writer can mend
  }
  if (access(folder_.c_str(), W_OK) != 0) throw unusable(folder_, std::strerror(errno));
  if (!has_room())
    throw StoreError(
        folder_.string() + ": the disk is full; delete sessions, or what else is on it", true);
  if (!was_ready) take_in_logs();
  is_ready_ = true;
}

/// Where it is full, the oldest evidence goes until it is not.
bool Store::has_room() {
  std::error_code error;
  const auto is_full = [&] {
    const auto free = std::filesystem::space(folder_, error).available;
    return (!error && free < least_free_bytes) || !lay_reserve();
  };
  while (is_full())
    if (!make_room()) return false;
  return true;
}

void Store::read_folder() {
  sessions_.clear();
  std::error_code error;
  for (std::filesystem::directory_iterator item(folder_, error), end; !error && item != end;
       item.increment(error)) {
    std::error_code ignored;
    if (lock_ >= 0 && item->path().extension() == ".new")
      std::filesystem::remove(item->path(), ignored);
    if (const auto id = id_of(item->path())) sessions_[*id] = entry_of(item->path());
  }
  const bool is_absent =
      error == std::errc::no_such_file_or_directory || error == std::errc::not_a_directory;
  if (error && !is_absent) throw unusable(folder_, error.message());
  last_id_ = std::max(last_id_, last_deleted());
  if (!sessions_.empty()) last_id_ = std::max(last_id_, sessions_.rbegin()->first);
  is_read_ = true;
}

/// A number is never given twice, though the newest session was deleted.
std::int64_t Store::last_deleted() const {
  const std::filesystem::path file = state_dir_ / "last-session";
  std::error_code error;
  if (!std::filesystem::exists(file, error)) return 0;
  try {
    return std::atoll(read_text_file(file).c_str());
  } catch (const InputError& unreadable) {
    throw StoreError(unreadable.what());
  }
}

/// Of a file that was left in the middle, its log is taken in, where there is room for that.
Store::Entry Store::entry_of(const std::filesystem::path& file) const {
  Entry out{file, {}, {}, false, {}};
  try {
    const bool has_log = was_cut(file);
    const SessionFile session(file,
                              has_log ? SessionFile::For::writing : SessionFile::For::reading);
    out.facts = session.facts();
    out.calibrations = session.calibrations();
    out.has_evidence = session.evidence_bytes() > 0;
    if (has_log) seal(session);
  } catch (const StoreError& error) {
    out.problem = error.what();
  }
  return out;
}

/// Not now: then it is read with its log once more when there is room.
void Store::seal(const SessionFile& session) {
  try {
    session.seal();
  } catch (const StoreError&) {
  }
}

/// Of the sessions that were left in the middle while nothing could be written.
void Store::take_in_logs() {
  for (auto& [id, entry] : sessions_)
    if (id != current_id_ && was_cut(entry.file)) entry = entry_of(entry.file);
}

SessionFile& Store::current() {
  if (!current_) throw StoreError("no session is under way");
  return *current_;
}

/// Does `work`, which writes. Where the disk is full, the oldest evidence goes until there is room.
template <typename Work>
auto Store::written(const Work& work) {
  for (;;) {
    try {
      return work();
    } catch (const StoreError& error) {
      if (!error.disk_is_full || !make_room()) throw;
    }
  }
}

/// Room that deleting needs, kept while there is some. False: there is none.
bool Store::lay_reserve() {
  const std::filesystem::path reserve = state_dir_ / "reserve";
  std::error_code error;
  if (std::filesystem::exists(reserve, error)) return true;
  const int fd = open(reserve.c_str(), O_WRONLY | O_CREAT | O_CLOEXEC, 0640);
  if (fd < 0) return false;
  const bool is_laid = posix_fallocate(fd, 0, reserve_bytes) == 0;
  close(fd);
  if (!is_laid) unlink(reserve.c_str());
  return is_laid;
}

/// False: there is no evidence left but that of the session under way.
bool Store::make_room() {
  for (auto& [id, entry] : sessions_) {
    if (!entry.has_evidence || id == current_id_) continue;
    entry.has_evidence = false;
    std::error_code ignored;
    std::filesystem::remove(state_dir_ / "reserve", ignored);
    try {
      const SessionFile session(entry.file, SessionFile::For::writing);
      session.drop_evidence();
      session.seal();
      lay_reserve();
      return true;
    } catch (const StoreError&) {  // then that of the next one
    }
  }
  return false;
}

std::int64_t Store::start_session(SessionFacts facts) {
  ready();
  facts.id = last_id_ + 1;
  const std::filesystem::path file = folder_ / name_of(facts.id);
  current_.reset();
  current_id_ = 0;
  current_.emplace(written([&] { return SessionFile::make(file, facts); }));
  current_id_ = last_id_ = facts.id;
  sessions_[facts.id] = {file, std::move(facts), {}, false, {}};
  return current_id_;
}

std::optional<std::int64_t> Store::open_session() const {
  return current_ ? std::optional(current_id_) : std::nullopt;
}

SessionFacts Store::facts() const { return sessions_.at(current_id_).facts; }

void Store::stop_session(const std::string& utc) {
  written([&] { current().set_stopped(utc); });
  SessionFacts& facts = sessions_.at(current_id_).facts;
  facts.state = "solving";
  facts.stopped_utc = utc;
}

void Store::set_devices(const Json& devices) {
  written([&] { current().set_devices(devices); });
  sessions_.at(current_id_).facts.devices = devices;
}

void Store::add_flights(const std::vector<Track>& flights) {
  written([&] { current().add_flights(flights); });
}

std::int64_t Store::add_calibration(StoredCalibration calibration) {
  written([&] { calibration.number = current().add_calibration(calibration); });
  const std::int64_t id = current_id_ * ids_per_session + calibration.number;
  sessions_.at(current_id_).calibrations = current().calibrations();
  return id;
}

void Store::add_evidence(const std::vector<Evidence>& evidence) {
  if (evidence.empty()) return;
  std::error_code error;
  const auto free = [&] { return std::filesystem::space(folder_, error).available; };
  while (free() < settings_.keep_free_bytes)
    if (!make_room())
      throw StoreError(folder_.string() + ": less than " +
                       std::to_string(settings_.keep_free_bytes / 1'000'000) + " MB are free");
  written([&] { current().add_evidence(evidence); });
  sessions_.at(current_id_).has_evidence = true;
}

void Store::finish_session(const std::string& state) {
  written([&] { current().set_state(state); });
  sessions_.at(current_id_).facts.state = state;
  current().seal();
  current_.reset();
  current_id_ = 0;
}

std::optional<Store::Unsolved> Store::resume(const std::vector<std::string>& cameras) {
  ready();
  if (sessions_.empty() || current_) return {};
  auto& [id, entry] = *sessions_.rbegin();
  if (!entry.problem.empty() || is_over(entry.facts) || entry.facts.cameras != cameras) return {};
  try {
    SessionFile file(entry.file, SessionFile::For::writing);
    Unsolved out{id, entry.facts, file.flights()};
    current_.emplace(std::move(file));
    current_id_ = id;
    return out;
  } catch (const StoreError& error) {
    entry.problem = error.what();
    throw;
  }
}

std::optional<Store::Json> Store::document_of(std::int64_t session, std::int64_t number) const {
  const Entry& entry = sessions_.at(session);
  const auto stored = session == current_id_
                          ? current_->calibration(number)
                          : SessionFile(entry.file, SessionFile::For::reading).calibration(number);
  if (!stored) return {};
  Json document = Json::parse(stored->document, nullptr, false);
  if (!document.is_object())
    throw StoreError(entry.file.string() + ": calibration " + std::to_string(number) +
                     " is no JSON object");
  document["id"] = session * ids_per_session + number;
  document["session"] = session;
  return document;
}

std::optional<Store::Json> Store::latest_calibration() const {
  for (auto each = sessions_.rbegin(); each != sessions_.rend(); ++each) {
    const auto& [id, entry] = *each;
    if (!entry.calibrations.empty() && entry.facts.state != "aborted")
      return document_of(id, entry.calibrations.back().number);
  }
  return {};
}

std::optional<Store::Json> Store::calibration(std::int64_t id) const {
  if (id <= 0 || !sessions_.contains(id / ids_per_session)) return {};
  return document_of(id / ids_per_session, id % ids_per_session);
}

Store::Json Store::calibration_list() const {
  constexpr std::size_t longest = 1000;
  Json out = Json::array();
  for (auto each = sessions_.rbegin(); each != sessions_.rend() && out.size() < longest; ++each) {
    const auto& [id, entry] = *each;
    if (entry.calibrations.empty() || entry.facts.state == "aborted") continue;
    const StoredCalibration& last = entry.calibrations.back();
    out.push_back({{"id", id * ids_per_session + last.number},
                   {"session", id},
                   {"created_utc", last.created_utc},
                   {"verdict", last.verdict},
                   {"throws", last.throws}});
  }
  return out;
}

Store::Json Store::summary(std::int64_t id, const Entry& entry) const {
  std::error_code error;
  const auto bytes = std::filesystem::file_size(entry.file, error);
  Json out{{"session", id}, {"file", entry.file.filename().string()}, {"bytes", error ? 0 : bytes}};
  if (!entry.problem.empty()) {
    out["problem"] = entry.problem;
    return out;
  }
  const SessionFacts& facts = entry.facts;
  out["state"] = id == current_id_ || is_over(facts) ? facts.state : "interrupted";
  out["started_utc"] = facts.started_utc;
  out["stopped_utc"] = facts.stopped_utc.empty() ? Json(nullptr) : Json(facts.stopped_utc);
  out["unit"] = facts.unit;
  out["cameras"] = facts.cameras;
  out["has_evidence"] = entry.has_evidence;
  const bool has_result = !entry.calibrations.empty();
  out["throws"] = has_result ? entry.calibrations.back().throws : 0;
  out["verdict"] = has_result ? Json(entry.calibrations.back().verdict) : Json(nullptr);
  return out;
}

Store::Json Store::session_list() const {
  constexpr std::size_t longest = 1000;
  Json out = Json::array();
  for (auto each = sessions_.rbegin(); each != sessions_.rend() && out.size() < longest; ++each)
    out.push_back(summary(each->first, each->second));
  return out;
}

std::optional<Store::Json> Store::session(std::int64_t id) const {
  const auto found = sessions_.find(id);
  if (found == sessions_.end()) return {};
  Json out = summary(id, found->second);
  out["software"] = found->second.facts.software;
  out["devices"] = found->second.facts.devices;
  out["calibrations"] = Json::array();
  for (const StoredCalibration& each : found->second.calibrations)
    out["calibrations"].push_back({{"id", id * ids_per_session + each.number},
                                   {"created_utc", each.created_utc},
                                   {"verdict", each.verdict},
                                   {"throws", each.throws},
                                   {"flights", each.flights}});
  return out;
}

std::optional<std::filesystem::path> Store::file_of(std::int64_t id) const {
  const auto found = sessions_.find(id);
  if (found == sessions_.end() || id == current_id_) return {};
  const auto& [file, facts, calibrations, has_evidence, problem] = found->second;
  if (!problem.empty()) throw StoreError(problem);
  if (was_cut(file))
    throw StoreError(file.string() + ": is not whole before the box has room to mend it");
  return file;
}

void Store::delete_session(std::int64_t id) {
  const auto found = sessions_.find(id);
  if (found == sessions_.end() || id == current_id_)
    throw StoreError("session " + std::to_string(id) + " is not there, or is under way");
  std::error_code error;
  std::filesystem::remove(state_dir_ / "reserve", error);  // for this it is there
  try {
    write_text_file(state_dir_ / "last-session", std::to_string(last_id_) + "\n");
  } catch (const InputError& unwritable) {
    throw StoreError(unwritable.what());
  }
  const std::filesystem::path file = found->second.file;
  for (const auto& log : logs_of(file)) std::filesystem::remove(log, error);
  if (!std::filesystem::remove(file, error))
    throw StoreError(file.string() + ": can't be removed: " + error.message());
  sessions_.erase(found);
  lay_reserve();
}

}  // namespace throwcal
