#pragma once

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <stdexcept>
#include <string>
#include <string_view>

struct sqlite3;
struct sqlite3_stmt;

namespace kiln::store {

/// SQLite refused where our own statements can't be at fault: disk full, I/O error, damaged file.
class DatabaseError : public std::runtime_error {
 public:
  DatabaseError(const std::string& what, bool full) : std::runtime_error(what), disk_full(full) {}
  bool disk_full = false;
};

/// One prepared statement. Bind by position from 1, step, read columns from 0.
class Statement {
 public:
  Statement(sqlite3*, std::string_view sql);
  Statement(Statement&& other) noexcept : handle_(other.handle_) { other.handle_ = nullptr; }
  Statement& operator=(Statement&&) = delete;
  ~Statement();

  Statement& bind(int index, std::string_view text);
  Statement& bind(int index, std::int64_t number);
  Statement& bind(int index, double number);
  bool step();  ///< true while there is a row
  std::string text(int column) const;
  std::int64_t number(int column) const;
  double real(int column) const;

 private:
  sqlite3_stmt* handle_ = nullptr;
};

/// One connection in WAL mode. Not thread-safe: guard it. Throws DatabaseError.
///
/// This wraps SQLite itself and not SQLiteCpp: each transaction chooses its durability, an error
/// says whether the disk is full, and the headers that use it name no library.
class Database {
 public:
  explicit Database(const std::filesystem::path&);
  Database(const Database&) = delete;
  Database& operator=(const Database&) = delete;
  ~Database();

  void run(const std::string& sql);
  Statement prepare(std::string_view sql) { return Statement(handle_, sql); }

  enum class Durability {
    kProgress,  ///< survives a killed process, may be lost with the power
    kPromise,   ///< on the disk when the call returns
  };
  /// Runs `body` in one transaction; rolls back when it throws.
  void transaction(Durability, const std::function<void()>& body);
  /// `hook` is called with the seconds that each committed transaction took.
  void on_commit(std::function<void(double)> hook) { on_commit_ = std::move(hook); }

 private:
  sqlite3* handle_ = nullptr;
  std::function<void(double)> on_commit_;
};

}  // namespace kiln::store
