#pragma once
// SQLite with values and sentences instead of codes. One thread at a time.

#include <sqlite3.h>

#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <string_view>

#include "common/outcome/contract.h"
#include "common/outcome/outcome.h"

namespace ridgecast::edit_log {

using Bytes = std::span<const std::uint8_t>;

// A prepared statement. Destroyed before its database.
class Statement {
 public:
  Statement() = default;
  Statement(sqlite3_stmt* statement, std::string file) : statement_(statement), file_(std::move(file)) {}

  // Runs it to its end with these values for ?1, ?2, ...
  template <class... Values>
  Outcome<void> run(const Values&... values) {
    Rows rows(*this, values...);
    for (;;)
      if (const auto row = rows.next(); !row || !*row) return row ? Outcome<void>() : row.error();
  }

  // The rows that it returns; while a Rows exists, the statement keeps others from checkpoints.
  class Rows {
   public:
    template <class... Values>
    explicit Rows(Statement& of, const Values&... values) : of_(of) {
      int index = 0;
      (of.bind(++index, values), ...);
    }
    ~Rows() { sqlite3_reset(statement()); }
    Rows(const Rows&) = delete;
    Rows& operator=(const Rows&) = delete;

    Outcome<bool> next();  // whether there is another row
    // Columns of this row, until next().
    std::int64_t integer(int column) const { return sqlite3_column_int64(statement(), column); }
    std::uint64_t number(int column) const { return static_cast<std::uint64_t>(integer(column)); }
    Bytes bytes(int column) const;
    std::string_view text(int column) const;

   private:
    sqlite3_stmt* statement() const { return of_.statement_.get(); }
    Statement& of_;
  };

 private:
  static void bound(int code) {
    expects(code != SQLITE_MISUSE && code != SQLITE_RANGE, "values are given to a statement at rest that has them");
  }
  void bind(int index, std::int64_t value) { bound(sqlite3_bind_int64(statement_.get(), index, value)); }
  void bind(int index, std::uint64_t value) { bind(index, static_cast<std::int64_t>(value)); }
  void bind(int index, std::string_view text) {
    bound(sqlite3_bind_text64(statement_.get(), index, text.data() ? text.data() : "", text.size(), SQLITE_STATIC, SQLITE_UTF8));
  }
  void bind(int index, Bytes bytes) { bound(sqlite3_bind_blob64(statement_.get(), index, bytes.data(), bytes.size(), SQLITE_STATIC)); }

  struct Finalize {
    void operator()(sqlite3_stmt* statement) const { sqlite3_finalize(statement); }
  };
  std::unique_ptr<sqlite3_stmt, Finalize> statement_;
  std::string file_;
};

class Database {
 public:
  // `flags` as of sqlite3_open_v2; no file: a temporary one. A file that it makes is readable by its owner alone. Sentences name the file
  // without its folder.
  static Outcome<Database> open(const std::filesystem::path& file, int flags);

  Outcome<void> run(const char* sql);  // statements separated by semicolons
  Outcome<Statement> prepare(const char* sql);
  Outcome<std::int64_t> integer(const char* sql);  // the first column of the first row; 0: no row
  sqlite3* handle() const { return handle_.get(); }
  const std::string& name() const { return file_; }  // of the file, without its folder
  Error error() const;                               // the last one

 private:
  struct Close {
    void operator()(sqlite3* handle) const { sqlite3_close_v2(handle); }
  };
  std::unique_ptr<sqlite3, Close> handle_;
  std::string file_;
};

// Rolled back when destroyed, unless committed.
class Transaction {
 public:
  explicit Transaction(Database& database) : database_(database) {}
  ~Transaction() {
    if (!sqlite3_get_autocommit(database_.handle())) (void)database_.run("ROLLBACK");
  }
  Transaction(const Transaction&) = delete;
  Transaction& operator=(const Transaction&) = delete;
  Outcome<void> begin() {
    expects(sqlite3_get_autocommit(database_.handle()), "one transaction at a time");
    return database_.run("BEGIN IMMEDIATE");
  }
  Outcome<void> commit() { return database_.run("COMMIT"); }

 private:
  Database& database_;
};

}  // namespace ridgecast::edit_log
