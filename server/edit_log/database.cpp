#include "server/edit_log/database.h"

#include <system_error>

#include "server/edit_log/lock.h"

namespace ridgecast::edit_log {
namespace {

Error errorOf(sqlite3* database, const std::string& file) {
  const std::string name = "'" + file + "'", detail = std::string(" (") + sqlite3_errmsg(database) + ")";
  switch (sqlite3_errcode(database) & 0xff) {
    case SQLITE_NOTADB:
      return {name + " is not a log of edits."};
    case SQLITE_BUSY:
    case SQLITE_LOCKED:
      return inUse(file);
    case SQLITE_CORRUPT:
    case SQLITE_ERROR:  // a table is missing
    case SQLITE_MISMATCH:
      return {name + " is damaged" + detail + "; put a backup in its place."};
    case SQLITE_CONSTRAINT:
      return {name + " has an edit with this number or key already."};
    case SQLITE_FULL:
      return {"Cannot write " + name + ": there is no room on the disk."};
    case SQLITE_NOMEM:
      return {"Cannot read " + name + ": there is no memory left."};
    default:
      return {"Cannot read or write " + name + detail + "; check that its folder exists, is writable and on a sound disk."};
  }
}

}  // namespace

Outcome<bool> Statement::Rows::next() {
  const int code = sqlite3_step(statement());
  if (code == SQLITE_ROW) return true;
  if (code == SQLITE_DONE) return false;
  return errorOf(sqlite3_db_handle(statement()), of_.file_);
}

Bytes Statement::Rows::bytes(int column) const {
  const auto* const data = static_cast<const std::uint8_t*>(sqlite3_column_blob(statement(), column));
  return {data, static_cast<std::size_t>(sqlite3_column_bytes(statement(), column))};
}

std::string_view Statement::Rows::text(int column) const {
  const Bytes all = bytes(column);
  return {reinterpret_cast<const char*>(all.data()), all.size()};
}

Outcome<Database> Database::open(const std::filesystem::path& file, int flags) {
  Database out;
  sqlite3* handle = nullptr;
  std::error_code failed;
  const bool isNew = !file.empty() && !std::filesystem::exists(file, failed);
  const int code = sqlite3_open_v2(file.c_str(), &handle, flags, nullptr);
  out.handle_.reset(handle);
  out.file_ = file.empty() ? "a temporary file" : file.filename().string();
  if (code != SQLITE_OK) return out.error();
  using std::filesystem::perms;
  if (isNew) std::filesystem::permissions(file, perms::owner_read | perms::owner_write, failed);  // its journals' follow
  return out;
}

Outcome<void> Database::run(const char* sql) {
  if (sqlite3_exec(handle(), sql, nullptr, nullptr, nullptr) != SQLITE_OK) return error();
  return {};
}

Outcome<Statement> Database::prepare(const char* sql) {
  sqlite3_stmt* statement = nullptr;
  if (sqlite3_prepare_v3(handle(), sql, -1, SQLITE_PREPARE_PERSISTENT, &statement, nullptr) != SQLITE_OK) return error();
  return Statement(statement, file_);
}

Outcome<std::int64_t> Database::integer(const char* sql) {
  auto statement = prepare(sql);
  if (!statement) return statement.error();
  Statement::Rows rows(*statement);
  const auto row = rows.next();
  if (!row) return row.error();
  return *row ? rows.integer(0) : 0;
}

Error Database::error() const { return errorOf(handle(), file_); }

}  // namespace ridgecast::edit_log
