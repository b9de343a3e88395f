#pragma once

#include <cstdint>
#include <optional>
#include <string>

struct sqlite3;
struct sqlite3_stmt;

namespace sweepvi::service {

class Database;

/// One SQL statement with its values, from preparation to its last row.
class Statement {
public:
  Statement(const Database& database, const std::string& sql);
  ~Statement();
  Statement(const Statement&) = delete;
  Statement& operator=(const Statement&) = delete;

  // The next value for a `?`.
  Statement& with(std::int64_t value);
  Statement& with(double value);
  Statement& with(const std::string& value);
  Statement& with_null();
  template <class T>
  Statement& with(const std::optional<T>& value) {
    return value ? with(*value) : with_null();
  }
  Statement& with(const std::optional<int>& value) {
    return value ? with(std::int64_t{*value}) : with_null();
  }

  /// Goes to the next row; false if there is none.
  bool step();
  /// For statements that return no rows.
  void run() { step(); }

  std::int64_t integer(int column) const;
  double real(int column) const;
  std::string text(int column) const;
  bool null(int column) const;

private:
  const Database& database_;
  sqlite3_stmt* statement_ = nullptr;
  int bound_ = 0;
};

/// An SQLite database with a write-ahead log. What is committed is on the disk. One thread at a time.
class Database {
public:
  /// @throws std::runtime_error, as all that follows
  explicit Database(const std::string& path);
  ~Database();
  Database(const Database&) = delete;
  Database& operator=(const Database&) = delete;

  void run(const std::string& sql) const { Statement(*this, sql).run(); }
  std::int64_t last_id() const;
  int changes() const;  ///< rows that the last statement changed

private:
  friend class Statement;
  [[noreturn]] void fail() const;
  sqlite3* handle_ = nullptr;
};

/// All or nothing: what was not committed when it ends never was.
class Transaction {
public:
  explicit Transaction(const Database& database) : database_(database) { database_.run("BEGIN IMMEDIATE"); }
  ~Transaction();
  Transaction(const Transaction&) = delete;
  Transaction& operator=(const Transaction&) = delete;
  void commit();

private:
  const Database& database_;
  bool open_ = true;
};

}  // namespace sweepvi::service
