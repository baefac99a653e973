// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "firmware/session_file.h"

namespace throwcal {

struct StoreSettings {
  std::uint64_t keep_free_bytes = 64'000'000;  ///< of the disk; evidence makes room for it
};

/// What the box keeps: STATE_DIR/sessions, one file a session. What a call has taken is on the disk
/// when it returns; else it throws StoreError and may be asked again. One thread.
class Store {
 public:
  using Json = nlohmann::ordered_json;

  /// Throws StoreError where another throwcald uses the folder. Whatever else is wrong with it is
  /// told by ready(): a box whose disk is gone still says so.
  explicit Store(std::filesystem::path state_dir, StoreSettings settings = {});
  ~Store();
  Store(const Store&) = delete;
  Store& operator=(const Store&) = delete;

  /// Opens what could not be opened before. Throws StoreError: why nothing can be kept now.
  void ready();

  // The session that is under way:
  std::int64_t start_session(SessionFacts facts);  ///< gives it the next id
  std::optional<std::int64_t> open_session() const;
  SessionFacts facts() const;
  void stop_session(const std::string& utc);
  void set_devices(const Json& devices);
  void add_flights(const std::vector<Track>& flights);
  /// Returns its id, which no other calibration has.
  std::int64_t add_calibration(StoredCalibration calibration);
  /// None of it where keep_free_bytes are not free, and no older evidence can make room.
  void add_evidence(const std::vector<Evidence>& evidence);
  void finish_session(const std::string& state);  ///< "done" or "aborted"

  /// A session that was begun but whose result was never made: the box was switched off. Only the
  /// newest, and only if the rig still has the same cameras. It is under way then.
  struct Unsolved {
    std::int64_t session = 0;
    SessionFacts facts;
    std::vector<Track> flights;
  };
  /// Throws StoreError also where its flights can't be read: it is not under way then, and later
  /// calls return nothing.
  std::optional<Unsolved> resume(const std::vector<std::string>& cameras);

  // What is there. Calibration documents have their `id` and `session`.
  std::optional<Json> latest_calibration() const;  ///< of no session that was thrown away
  std::optional<Json> calibration(std::int64_t id) const;
  Json calibration_list() const;  ///< newest first: id, session, created_utc, verdict, throws
  Json session_list() const;      ///< newest first
  std::optional<Json> session(std::int64_t id) const;  ///< with its calibrations
  /// Of a session that is over. Throws StoreError where it can't be read, or not without its log.
  std::optional<std::filesystem::path> file_of(std::int64_t id) const;
  void delete_session(std::int64_t id);

 private:
  /// What is told of a session without opening its file again.
  struct Entry {
    std::filesystem::path file;
    SessionFacts facts;
    std::vector<StoredCalibration> calibrations;
    bool has_evidence = false;
    std::string problem;  ///< why it can't be read
  };

  void take_lock();
  void read_folder();
  Entry entry_of(const std::filesystem::path& file) const;
  static void seal(const SessionFile& session);
  void take_in_logs();
  std::int64_t last_deleted() const;
  SessionFile& current();
  template <typename Work>
  auto written(const Work& work);
  bool has_room();
  bool make_room();
  bool lay_reserve();
  Json summary(std::int64_t id, const Entry& entry) const;
  std::optional<Json> document_of(std::int64_t session, std::int64_t number) const;

  const std::filesystem::path state_dir_, folder_;
  const StoreSettings settings_;
  int lock_ = -1;
  bool is_read_ = false;
  bool is_ready_ = false;  ///< as of the last ready()
  std::int64_t last_id_ = 0;
  std::map<std::int64_t, Entry> sessions_;
  std::optional<SessionFile> current_;
  std::int64_t current_id_ = 0;
};

}  // namespace throwcal
