#include "nerf/base/progress.h"

#include <sys/ioctl.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <utility>

namespace nerf {
namespace {

constexpr int kBarCells = 24;
constexpr std::string_view kEraseLine = "\r\x1b[K";

double steady_seconds() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

std::string bar(double fraction) {
  const int full = static_cast<int>(std::floor(fraction * kBarCells));
  std::string cells(kBarCells, '.');
  std::fill_n(cells.begin(), full, '#');
  return " [" + cells + "]";
}

// Cuts to `columns` characters; a byte that continues a UTF-8 character takes no column and is
// never separated from its first byte.
std::string cut(const std::string& text, int columns) {
  int used = 0;
  for (size_t i = 0; i < text.size(); ++i) {
    const bool continues = (static_cast<unsigned char>(text[i]) & 0xC0) == 0x80;
    if (!continues && ++used > columns) return text.substr(0, i);
  }
  return text;
}

}  // namespace

std::string format_duration(double seconds) {
  // Beyond a year nobody cares, and a conversion to integers must stay defined.
  const auto whole = static_cast<long>(
      std::isfinite(seconds) ? std::clamp(std::round(seconds), 0.0, 366.0 * 86400) : 0.0);
  char text[64];
  if (whole < 60)
    std::snprintf(text, sizeof(text), "%lds", whole);
  else if (whole < 3600)
    std::snprintf(text, sizeof(text), "%ldm %02lds", whole / 60, whole % 60);
  else
    std::snprintf(text, sizeof(text), "%ldh %02ldm", whole / 3600, whole / 60 % 60);
  return text;
}

ProgressStyle style_of(std::FILE* stream) {
  ProgressStyle style;
  const int fd = fileno(stream);
  const char* term = std::getenv("TERM");
  style.terminal = fd >= 0 && isatty(fd) && term && std::strcmp(term, "dumb") != 0;
  winsize size{};
  if (style.terminal && ioctl(fd, TIOCGWINSZ, &size) == 0 && size.ws_col > 0)
    style.columns = size.ws_col;
  return style;
}

Progress::Progress(std::string title, std::FILE* stream)
    : Progress(std::move(title), style_of(stream), steady_seconds, [stream](std::string_view text) {
        std::fwrite(text.data(), 1, text.size(), stream);
        std::fflush(stream);
      }) {}

Progress::Progress(std::string title, ProgressStyle style, Clock clock, Write write)
    : title_(std::move(title)),
      style_(style),
      clock_(std::move(clock)),
      write_(std::move(write)),
      start_(clock_()) {
  if (!style_.terminal) last_drawn_ = start_;
}

Progress::~Progress() {
  try {
    finish();
  } catch (...) {  // a line that cannot be written is no reason to end the program
  }
}

void Progress::update(double fraction, const std::string& text,
                      std::optional<double> seconds_left) {
  if (finished_) return;
  fraction_ = fraction >= 0 ? std::min(fraction, 1.0) : 0.0;
  text_ = text;
  seconds_left_ = seconds_left;
  updated_ = true;
  drawn_current_ = false;
  const double now = clock_();
  const double since = now - last_drawn_;
  const bool due = style_.terminal
                       ? since >= style_.redraw_seconds
                       : since >= style_.line_seconds ||
                             (since >= 1 && fraction_ >= last_fraction_ + style_.line_fraction);
  if (due) draw(now);
}

void Progress::clear() {
  if (on_screen_) write_(kEraseLine);
  on_screen_ = false;
}

void Progress::finish() {
  if (finished_) return;
  finished_ = true;
  if (updated_ && !drawn_current_) draw(clock_());
  if (on_screen_) write_("\n");
}

std::string Progress::line(double now) const {
  char percent[16];
  // Rounded down: 100% is said only when all is done.
  std::snprintf(percent, sizeof(percent), "%3d%%", static_cast<int>(std::floor(fraction_ * 100)));
  std::string text = title_;
  if (style_.terminal) text += bar(fraction_);
  text += ' ';
  text += percent;
  if (!text_.empty()) text += "  " + text_;
  const double elapsed = now - start_;
  if (fraction_ >= 1)
    text += "  " + format_duration(elapsed);
  else if (seconds_left_)
    text += "  " + format_duration(*seconds_left_) + " left";
  else if (fraction_ > 0 && elapsed >= 1)
    text += "  " + format_duration(elapsed * (1 - fraction_) / fraction_) + " left";
  return text;
}

void Progress::draw(double now) {
  if (style_.terminal) {
    // One column stays free: a full line would wrap on some terminals.
    write_(std::string(kEraseLine) + cut(line(now), std::max(1, style_.columns - 1)));
    on_screen_ = true;
  } else {
    write_(line(now) + "\n");
  }
  last_drawn_ = now;
  last_fraction_ = fraction_;
  drawn_current_ = true;
}

}  // namespace nerf
