// SPDX-License-Identifier: BSD-3-Clause
#include "firmware/database.h"

namespace throwcal {
namespace {

std::string advice(int code) {
  switch (code & 0xff) {
    case SQLITE_NOTADB:
    case SQLITE_CORRUPT:
      return "; the file is damaged, or not one of throwcal's";
    case SQLITE_BUSY:
    case SQLITE_LOCKED:
      return "; is another throwcald using it?";
    case SQLITE_CANTOPEN:
    case SQLITE_READONLY:
    case SQLITE_PERM:
      return "; expected a folder that this user may write to";
    case SQLITE_IOERR:
      return "; the disk fails";
    case SQLITE_FULL:
      return "; the disk is full";
    default:
      return "";
  }
}

[[noreturn]] void fail(sqlite3* database) {
  const char* file = sqlite3_db_filename(database, "main");
  throw StoreError(std::string(file ? file : "store") + ": " + sqlite3_errmsg(database) +
                       advice(sqlite3_errcode(database)),
                   (sqlite3_errcode(database) & 0xff) == SQLITE_FULL);
}

void check(int code, sqlite3* database) {
  if (code != SQLITE_OK) fail(database);
}

}  // namespace

Statement::Statement(sqlite3* database, std::string_view sql) : database_(database) {
  sqlite3_stmt* statement = nullptr;
  check(sqlite3_prepare_v2(database, sql.data(), static_cast<int>(sql.size()), &statement, nullptr),
        database);
  statement_.reset(statement);
}

Statement& Statement::bind(std::int64_t value) {
  check(sqlite3_bind_int64(statement_.get(), next_++, value), database_);
  return *this;
}

Statement& Statement::bind(double value) {
  check(sqlite3_bind_double(statement_.get(), next_++, value), database_);
  return *this;
}

Statement& Statement::bind(std::string_view value) {
  check(sqlite3_bind_text64(statement_.get(), next_++, value.data(), value.size(), SQLITE_TRANSIENT,
                            SQLITE_UTF8),
        database_);
  return *this;
}

Statement& Statement::bind(const std::optional<double>& value) {
  if (value) return bind(*value);
  check(sqlite3_bind_null(statement_.get(), next_++), database_);
  return *this;
}

Statement& Statement::bind_bytes(std::string_view value) {
  check(
      sqlite3_bind_blob64(statement_.get(), next_++, value.data(), value.size(), SQLITE_TRANSIENT),
      database_);
  return *this;
}

bool Statement::step() {
  const int code = sqlite3_step(statement_.get());
  if (code == SQLITE_ROW) return true;
  if (code != SQLITE_DONE) fail(database_);
  return false;
}

void Statement::run() {
  while (step()) {
  }
  sqlite3_reset(statement_.get());
  next_ = 1;
}

std::optional<double> Statement::optional_number(int column) const {
  if (sqlite3_column_type(statement_.get(), column) == SQLITE_NULL) return {};
  return number(column);
}

std::string Statement::text(int column) const {
  // Also of what is no text: SQLite hands out a number's digits, and a BLOB's bytes as they are.
  const auto* data = static_cast<const char*>(sqlite3_column_blob(statement_.get(), column));
  const auto size = static_cast<std::size_t>(sqlite3_column_bytes(statement_.get(), column));
  return data ? std::string(data, size) : std::string();
}

Database::Database(const std::filesystem::path& file, Mode mode) {
  constexpr int reading = SQLITE_OPEN_READONLY, writing = SQLITE_OPEN_READWRITE;
  const int flags = mode == Mode::read    ? reading
                    : mode == Mode::write ? writing
                                          : writing | SQLITE_OPEN_CREATE;
  sqlite3* database = nullptr;
  const int code = sqlite3_open_v2(file.c_str(), &database, flags, nullptr);
  database_.reset(database);
  if (code != SQLITE_OK)
    throw StoreError(file.string() + ": " + sqlite3_errstr(code) + advice(code));
  sqlite3_extended_result_codes(database, 1);
  sqlite3_db_config(database, SQLITE_DBCONFIG_DEFENSIVE, 1, nullptr);
  execute("PRAGMA trusted_schema=OFF; PRAGMA cell_size_check=ON; PRAGMA foreign_keys=ON");
  if (mode == Mode::read) return;
  // FULL: a commit is on the disk when it returns. EXCLUSIVE: a second user is told so at once.
  execute("PRAGMA locking_mode=EXCLUSIVE; PRAGMA synchronous=FULL");
  execute(mode == Mode::make ? "PRAGMA journal_mode=DELETE" : "PRAGMA journal_mode=WAL");
}

void Database::seal() const {
  execute("PRAGMA wal_checkpoint(TRUNCATE); PRAGMA journal_mode=DELETE");
}

void Database::execute(const std::string& sql) const {
  check(sqlite3_exec(database_.get(), sql.c_str(), nullptr, nullptr, nullptr), database_.get());
}

}  // namespace throwcal
