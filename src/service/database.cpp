#include "service/database.hpp"

#include <sqlite3.h>

#include <cerrno>

namespace sweepvi::service {

Statement::Statement(const Database& database, const std::string& sql) : database_(database) {
  if (sqlite3_prepare_v2(database.handle_, sql.c_str(), -1, &statement_, nullptr) != SQLITE_OK)
    database.fail();
}

Statement::~Statement() {
  sqlite3_finalize(statement_);
}

Statement& Statement::with(std::int64_t value) {
  if (sqlite3_bind_int64(statement_, ++bound_, value) != SQLITE_OK) database_.fail();
  return *this;
}

Statement& Statement::with(double value) {
  if (sqlite3_bind_double(statement_, ++bound_, value) != SQLITE_OK) database_.fail();
  return *this;
}

Statement& Statement::with(const std::string& value) {
  if (sqlite3_bind_text64(statement_, ++bound_, value.data(), value.size(), SQLITE_TRANSIENT, SQLITE_UTF8) !=
      SQLITE_OK)
    database_.fail();
  return *this;
}

Statement& Statement::with_null() {
  if (sqlite3_bind_null(statement_, ++bound_) != SQLITE_OK) database_.fail();
  return *this;
}

bool Statement::step() {
  const int result = sqlite3_step(statement_);
  if (result != SQLITE_ROW && result != SQLITE_DONE) database_.fail();
  return result == SQLITE_ROW;
}

std::int64_t Statement::integer(int column) const {
  return sqlite3_column_int64(statement_, column);
}

double Statement::real(int column) const {
  return sqlite3_column_double(statement_, column);
}

std::string Statement::text(int column) const {
  const auto* bytes = static_cast<const char*>(sqlite3_column_blob(statement_, column));
  const int size = sqlite3_column_bytes(statement_, column);
  return bytes == nullptr ? std::string() : std::string(bytes, static_cast<std::size_t>(size));
}

bool Statement::null(int column) const {
  return sqlite3_column_type(statement_, column) == SQLITE_NULL;
}

Database::Database(const std::string& path, Use use) {
  const int flags = SQLITE_OPEN_NOMUTEX |
                    (use == Use::look ? SQLITE_OPEN_READONLY : SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE);
  if (sqlite3_open_v2(path.c_str(), &handle_, flags, nullptr) != SQLITE_OK) {
    const std::string reason = path + ": " + sqlite3_errmsg(handle_);
    sqlite3_close(handle_);
    throw DatabaseError(reason, false, false);
  }
  try {
    sqlite3_busy_timeout(handle_, 10000);  // ms
    if (use == Use::look) return;
    run("PRAGMA journal_mode = WAL");
    run("PRAGMA synchronous = FULL");
  } catch (...) {
    sqlite3_close(handle_);
    throw;
  }
}

Database::~Database() {
  sqlite3_close(handle_);
}

std::int64_t Database::last_id() const {
  return sqlite3_last_insert_rowid(handle_);
}

int Database::changes() const {
  return sqlite3_changes(handle_);
}

std::int64_t Database::number(const std::string& sql) const {
  Statement row(*this, sql);
  return row.step() ? row.integer(0) : 0;
}

bool Database::has_table(const std::string& name) const {
  Statement row(*this, "SELECT 1 FROM sqlite_master WHERE type = 'table' AND name = ?");
  row.with(name);
  return row.step();
}

bool Database::has_column(const std::string& table, const std::string& column) const {
  Statement row(*this, "SELECT 1 FROM pragma_table_info(?) WHERE name = ?");
  row.with(table).with(column);
  return row.step();
}

std::string Database::damage(const std::filesystem::path& path) {
  std::error_code failure;
  if (!std::filesystem::exists(path, failure)) return {};
  try {
    const Database database(path);
    Statement row(database, "PRAGMA quick_check(1)");
    const std::string found = row.step() ? row.text(0) : "";
    return found == "ok" ? "" : found;
  } catch (const DatabaseError& error) {
    if (!error.damaged()) throw;
    return error.what();
  }
}

void Database::fail() const {
  const int code = sqlite3_errcode(handle_);
  const int system = sqlite3_system_errno(handle_);
  const bool no_room =
      code == SQLITE_FULL || (code == SQLITE_IOERR && (system == ENOSPC || system == EDQUOT));
  throw DatabaseError(std::string("the queue's database: ") + sqlite3_errmsg(handle_), no_room,
                      code == SQLITE_NOTADB || code == SQLITE_CORRUPT);
}

Transaction::~Transaction() {
  if (!open_) return;
  try {
    database_.run("ROLLBACK");
  } catch (const std::exception&) {  // SQLite has done so itself
  }
}

void Transaction::commit() {
  database_.run("COMMIT");
  open_ = false;
}

}  // namespace sweepvi::service
