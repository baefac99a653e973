// SPDX-License-Identifier: BSD-3-Clause
#pragma once
#include <sqlite3.h>

#include <filesystem>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>

namespace throwcal {

/// The database refuses; what() names the file, the cause and what to do.
struct StoreError : std::runtime_error {
  explicit StoreError(const std::string& what, bool disk_is_full_ = false)
      : std::runtime_error(what), disk_is_full(disk_is_full_) {}
  bool disk_is_full;
};

/// A prepared statement: bind() all, then step() row by row, column by column.
class Statement {
 public:
  Statement(sqlite3* database, std::string_view sql);

  Statement& bind(std::int64_t value);
  Statement& bind(double value);
  Statement& bind(std::string_view value);        ///< copied
  Statement& bind_bytes(std::string_view value);  ///< a BLOB, copied
  Statement& bind(const std::optional<double>& value);
  bool step();  ///< true: there is a row
  void run();   ///< step to the end and make ready for the next use

  std::int64_t integer(int column) const { return sqlite3_column_int64(statement_.get(), column); }
  double number(int column) const { return sqlite3_column_double(statement_.get(), column); }
  std::optional<double> optional_number(int column) const;
  std::string text(int column) const;

 private:
  struct Finalize {
    void operator()(sqlite3_stmt* statement) const { sqlite3_finalize(statement); }
  };
  sqlite3* database_;
  std::unique_ptr<sqlite3_stmt, Finalize> statement_;
  int next_ = 1;
};

/// One SQLite file, used by one thread and one process at a time; every transaction is on the disk
/// when it returns. Nothing in the file is trusted: it runs no code of its own.
class Database {
 public:
  /// `write`: it must be there, and nobody else may use it meanwhile; its write-ahead log lies
  /// beside it until seal().
  enum class Mode { make, write, read };
  Database(const std::filesystem::path& file, Mode mode);

  Statement prepare(std::string_view sql) const { return {database_.get(), sql}; }
  void execute(const std::string& sql) const;  ///< statements without parameters
  /// All in the one file, nothing beside it, readable where nobody may write.
  void seal() const;
  std::int64_t last_id() const { return sqlite3_last_insert_rowid(database_.get()); }

  /// All of `work` or nothing.
  template <typename Work>
  void transaction(const Work& work) const {
    execute("BEGIN IMMEDIATE");
    try {
      work();
      execute("COMMIT");
    } catch (...) {
      sqlite3_exec(database_.get(), "ROLLBACK", nullptr, nullptr, nullptr);
      throw;
    }
  }

 private:
  struct Close {
    void operator()(sqlite3* database) const { sqlite3_close_v2(database); }
  };
  std::unique_ptr<sqlite3, Close> database_;
};

}  // namespace throwcal
