#include "server/store/database.h"

#include <sqlite3.h>

#include <chrono>

namespace kiln::store {
namespace {

[[noreturn]] void raise(sqlite3* db, const char* doing) {
  const int code = db ? sqlite3_errcode(db) : SQLITE_NOMEM;
  throw DatabaseError(
      std::string("job store, ") + doing + ": " + (db ? sqlite3_errmsg(db) : "out of memory"),
      code == SQLITE_FULL);
}

}  // namespace

Statement::Statement(sqlite3* db, std::string_view sql) {
  if (sqlite3_prepare_v2(db, sql.data(), static_cast<int>(sql.size()), &handle_, nullptr) !=
      SQLITE_OK)
    raise(db, "prepare");
}

Statement::~Statement() {
  sqlite3_finalize(handle_);
}

Statement& Statement::bind(int index, std::string_view text) {
  if (sqlite3_bind_text64(handle_, index, text.data(), text.size(), SQLITE_TRANSIENT,
                          SQLITE_UTF8) != SQLITE_OK)
    raise(sqlite3_db_handle(handle_), "bind");
  return *this;
}

Statement& Statement::bind(int index, std::int64_t number) {
  if (sqlite3_bind_int64(handle_, index, number) != SQLITE_OK)
    raise(sqlite3_db_handle(handle_), "bind");
  return *this;
}

Statement& Statement::bind(int index, double number) {
  if (sqlite3_bind_double(handle_, index, number) != SQLITE_OK)
    raise(sqlite3_db_handle(handle_), "bind");
  return *this;
}

bool Statement::step() {
  const int code = sqlite3_step(handle_);
  if (code == SQLITE_ROW) return true;
  if (code != SQLITE_DONE) raise(sqlite3_db_handle(handle_), "step");
  return false;
}

std::string Statement::text(int column) const {
  const unsigned char* bytes = sqlite3_column_text(handle_, column);
  const int size = sqlite3_column_bytes(handle_, column);
  return bytes ? std::string(bytes, bytes + size) : std::string();
}

std::int64_t Statement::number(int column) const {
  return sqlite3_column_int64(handle_, column);
}

double Statement::real(int column) const {
  return sqlite3_column_double(handle_, column);
}

Database::Database(const std::filesystem::path& path) {
  const int code =
      sqlite3_open_v2(path.c_str(), &handle_,
                      SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE | SQLITE_OPEN_NOMUTEX, nullptr);
  try {
    if (code != SQLITE_OK) raise(handle_, "open");
    sqlite3_busy_timeout(handle_, 5000);
    run("PRAGMA journal_mode=WAL");
    run("PRAGMA foreign_keys=ON");
  } catch (...) {
    sqlite3_close(handle_);
    throw;
  }
}

Database::~Database() {
  sqlite3_close(handle_);
}

void Database::run(const std::string& sql) {
  if (sqlite3_exec(handle_, sql.c_str(), nullptr, nullptr, nullptr) != SQLITE_OK)
    raise(handle_, "run");
}

void Database::transaction(Durability durability, const std::function<void()>& body) {
  const auto began = std::chrono::steady_clock::now();
  run(durability == Durability::kPromise ? "PRAGMA synchronous=FULL" : "PRAGMA synchronous=NORMAL");
  run("BEGIN IMMEDIATE");
  try {
    body();
    run("COMMIT");
  } catch (...) {
    // A failed COMMIT may have rolled back already: then this statement fails, which is fine.
    sqlite3_exec(handle_, "ROLLBACK", nullptr, nullptr, nullptr);
    throw;
  }
  if (on_commit_)
    on_commit_(std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count());
}

}  // namespace kiln::store
