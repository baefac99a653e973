// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <deque>
#include <optional>
#include <string>

#include "capture/rig.h"
#include "firmware/journal.h"
#include "firmware/news_box.h"
#include "firmware/session.h"
#include "firmware/store.h"

namespace throwcal {

/// What the estimator finds is stored first and told afterwards: the session knows of nothing that
/// a power cut could take back. What can't be stored now waits, in order, and is tried again.
class SessionKeeper {
 public:
  /// Borrows all for its life.
  SessionKeeper(Session& session, Store& store, Rig& rig, bool keep_evidence);

  /// A new session; why not, where it can't be.
  [[nodiscard]] std::optional<std::string> begin(SessionFacts facts, const SessionGoal& goal);
  /// No more throws.
  void stop(const std::string& utc);
  /// Throws the session away, at once; on the disk, as soon as it can be.
  [[nodiscard]] std::optional<std::string> abort();
  /// A session that was interrupted by a restart, to be solved. Nothing where fault() says that the
  /// store can't be asked now, or where there is none.
  std::optional<Store::Unsolved> resume(const std::vector<std::string>& cameras,
                                        const std::string& utc);
  /// It was deleted.
  void forget(std::int64_t session);

  void take(News news);
  /// Stores what waits. Call now and then.
  void catch_up();
  /// Why nothing can be kept now.
  const std::optional<std::string>& fault() const { return fault_; }
  /// Stores the pictures that wait, when there is time for it. What can't be stored of them is told
  /// once and let go: no calibration needs it.
  void store_evidence();
  /// Of the session's last calibration that is stored.
  const std::optional<std::int64_t>& calibration_id() const { return now_.calibration_id; }

 private:
  /// What is kept of one session, from its beginning until the next one's.
  struct Current {
    std::deque<News> waiting = {};          ///< to be stored, then told
    std::vector<Evidence> evidence = {};    ///< waits until everything else is stored
    std::vector<bool> has_background = {};  ///< a camera each: the session has its picture
    std::int64_t flights_stored = 0;
    std::optional<std::int64_t> calibration_id = {};
    bool began_here = false;                      ///< in this process: rig and cameras are its own
    std::optional<std::string> stopped_utc = {};  ///< to be stored
    bool is_aborted = false;                      ///< to be stored
  };

  template <typename Work>
  bool stored(const Work& work);
  void finish_aborted();
  void store_and_tell(News& news);
  void store_calibration(const News& news);
  void gather_backgrounds();
  void gather_evidence(const std::vector<Track>& flights);
  SessionFacts::Json devices_now() const;

  Session& session_;
  Store& store_;
  Rig& rig_;
  const bool keep_evidence_;
  LogOnce once_;
  Current now_;
  std::optional<std::string> fault_;
};

}  // namespace throwcal
