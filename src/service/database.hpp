#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <stdexcept>
#include <string>

struct sqlite3;
struct sqlite3_stmt;

namespace sweepvi::service {

class Database;

/// What SQLite could not do.
class DatabaseError : public std::runtime_error {
public:
  DatabaseError(const std::string& message, bool no_room, bool damaged)
      : std::runtime_error(message), no_room_(no_room), damaged_(damaged) {}
  bool no_room() const noexcept { return no_room_; }  ///< the disk is full
  bool damaged() const noexcept { return damaged_; }  ///< the file is no database, or not a whole one

private:
  bool no_room_, damaged_;
};

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
  enum class Use {
    work,  ///< made if it is missing
    look   ///< nothing is written; it must be there
  };
  /// @throws DatabaseError, as all that follows
  explicit Database(const std::string& path, Use use = Use::work);
  ~Database();
  Database(const Database&) = delete;
  Database& operator=(const Database&) = delete;

  void run(const std::string& sql) const { Statement(*this, sql).run(); }
  std::int64_t last_id() const;
  int changes() const;  ///< rows that the last statement changed
  /// The first column of the first row; 0 if there is none.
  std::int64_t number(const std::string& sql) const;
  bool has_table(const std::string& name) const;
  bool has_column(const std::string& table, const std::string& column) const;

  /// What is wrong with the file, by SQLite's own check; empty if nothing is, or if it is not there.
  static std::string damage(const std::filesystem::path& path);

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
