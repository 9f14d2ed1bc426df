#pragma once

#include <chrono>
#include <cstdio>
#include <mutex>
#include <string>

#include "proto/job.h"

namespace kiln::cli {

/// Shows the progress of a bake. On a terminal it redraws one line; elsewhere it prints a line per
/// stage, pass and tenth of the whole. It writes to stderr. Callable from many threads.
class ProgressView {
 public:
  enum class Style { kBar, kLines, kQuiet };

  explicit ProgressView(Style, std::FILE* out = stderr);
  ~ProgressView();  ///< ends a bar's line
  ProgressView(const ProgressView&) = delete;
  ProgressView& operator=(const ProgressView&) = delete;

  void update(const proto::JobProgress&);
  /// Prints a line above the bar, or nothing when quiet.
  void note(const std::string&);
  void finish();  ///< clears the bar

  /// Returns kQuiet when `quiet` is set, kBar when stderr is a terminal, else kLines.
  static Style style_for(bool quiet);

 private:
  const Style style_;
  std::FILE* const out_;
  const std::chrono::steady_clock::time_point start_;
  std::mutex mutex_;
  std::string last_line_;                        // guarded by mutex_
  std::string last_key_;                         // guarded by mutex_
  std::chrono::steady_clock::time_point drawn_;  // guarded by mutex_

  std::string elapsed() const;
  void draw_bar(const proto::JobProgress&);
  void print_line(const proto::JobProgress&);
  void clear();
};

/// Returns the words that both styles show: "solve, pass 3 of at most 17, last change 2.1 %".
std::string progress_words(const proto::JobProgress&);

}  // namespace kiln::cli
