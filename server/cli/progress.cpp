#include "server/cli/progress.h"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <cstdlib>
#include <string_view>

namespace kiln::cli {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::size_t kBarCells = 24;

double share(const proto::JobProgress& p) {
  return std::clamp(p.fraction, 0.0, 1.0);
}

std::string percent(const proto::JobProgress& p) {
  return std::to_string(static_cast<int>(share(p) * 100)) + " %";
}

std::string time_left(const proto::JobProgress& p) {
  if (!p.eta_seconds) return "";
  const auto s = static_cast<long long>(*p.eta_seconds + 0.5);
  std::array<char, 48> text{};
  std::snprintf(text.data(), text.size(), ", %lld:%02lld left", s / 60, s % 60);
  return text.data();
}

std::string residual_text(const proto::JobProgress& p) {
  if (p.stage != "solve" || p.pass == 0) return "";
  std::array<char, 48> text{};
  std::snprintf(text.data(), text.size(), ", last change %.3g %%", p.residual * 100);
  return text.data();
}

}  // namespace

std::string progress_words(const proto::JobProgress& p) {
  std::string words = p.stage.empty() ? "waiting" : p.stage;
  if (p.max_passes > 0)
    words += ", pass " + std::to_string(p.pass + 1) + " of at most " + std::to_string(p.max_passes);
  return words + residual_text(p) + time_left(p);
}

ProgressView::ProgressView(Style style, std::FILE* out)
    : style_(style), out_(out), start_(Clock::now()) {}

ProgressView::~ProgressView() {
  finish();
}

ProgressView::Style ProgressView::style_for(bool quiet) {
  if (quiet) return Style::kQuiet;
  const char* term = std::getenv("TERM");
  const bool dumb = term == nullptr || std::string_view(term) == "dumb";
  return ::isatty(STDERR_FILENO) == 1 && !dumb ? Style::kBar : Style::kLines;
}

std::string ProgressView::elapsed() const {
  const auto s = std::chrono::duration_cast<std::chrono::seconds>(Clock::now() - start_).count();
  std::array<char, 32> text{};
  std::snprintf(text.data(), text.size(), "%lld:%02lld", static_cast<long long>(s / 60),
                static_cast<long long>(s % 60));
  return text.data();
}

void ProgressView::update(const proto::JobProgress& p) {
  if (style_ == Style::kQuiet) return;
  const std::lock_guard lock(mutex_);
  if (style_ == Style::kBar)
    draw_bar(p);
  else
    print_line(p);
}

void ProgressView::note(const std::string& text) {
  if (style_ == Style::kQuiet) return;
  const std::lock_guard lock(mutex_);
  clear();
  std::fprintf(out_, "%s\n", text.c_str());
  std::fputs(last_line_.c_str(), out_);
  std::fflush(out_);
}

void ProgressView::finish() {
  const std::lock_guard lock(mutex_);
  clear();
  last_line_.clear();
  std::fflush(out_);
}

void ProgressView::draw_bar(const proto::JobProgress& p) {
  const auto now = Clock::now();
  if (!last_line_.empty() && now - drawn_ < std::chrono::milliseconds(80)) return;
  drawn_ = now;
  const auto full = static_cast<std::size_t>(share(p) * kBarCells);
  const std::string bar = std::string(full, '#') + std::string(kBarCells - full, '.');
  clear();
  last_line_ = "[" + bar + "] " + percent(p) + "  " + elapsed() + "  " + progress_words(p);
  if (last_line_.size() > 110) last_line_.resize(110);
  std::fputs(last_line_.c_str(), out_);
  std::fflush(out_);
}

void ProgressView::print_line(const proto::JobProgress& p) {
  const std::string key = p.stage + "/" + std::to_string(p.pass) + "/" +
                          std::to_string(static_cast<int>(share(p) * 10));
  if (key == last_key_) return;
  last_key_ = key;
  std::fprintf(out_, "%s  %s  %s\n", elapsed().c_str(), percent(p).c_str(),
               progress_words(p).c_str());
  std::fflush(out_);
}

void ProgressView::clear() {
  if (style_ == Style::kBar && !last_line_.empty()) std::fputs("\r\x1b[2K", out_);
}

}  // namespace kiln::cli
