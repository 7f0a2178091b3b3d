// Progress of a long job for a person: one line that redraws itself on a terminal, whole lines now
// and then where the output goes to a file or a pipe.
#pragma once

#include <chrono>
#include <cstdio>
#include <functional>
#include <optional>
#include <string>
#include <string_view>

namespace nerf {

// Whole seconds as "45s", "3m 07s" or "2h 05m".
std::string format_duration(double seconds);

struct ProgressStyle {
  bool terminal = false;        // redraw in place
  int columns = 80;             // a terminal's width: the line is cut to it
  double redraw_seconds = 0.1;  // terminal: not more often than this
  double line_seconds = 10;     // otherwise: a line at most this often ...
  double line_fraction = 0.1;   // ... or whenever this much more of the job is done and a second
                                // has passed
};

// Whether `stream` is a terminal that understands carriage returns, and its width now.
ProgressStyle style_of(std::FILE* stream);

// Not for use from several threads at once.
class Progress {
 public:
  using Clock = std::function<double()>;                // seconds, never goes back
  using Write = std::function<void(std::string_view)>;  // text exactly as given

  // Writes to `stream` in the style that it calls for.
  explicit Progress(std::string title, std::FILE* stream = stderr);
  // For tests and other outputs.
  Progress(std::string title, ProgressStyle style, Clock clock, Write write);
  ~Progress();  // as finish()
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  // `fraction` done in [0, 1] (clamped; not a number counts as 0) and text of your own, without
  // line breaks: "step 1200, 25.1 dB". Draws only when it is time to. Time left is estimated from
  // the speed since the start, once there is enough to go by, unless the caller knows better
  // (`seconds_left`).
  void update(double fraction, const std::string& text = "",
              std::optional<double> seconds_left = std::nullopt);

  // Takes the bar off the terminal, so that something else can be printed; the next update draws it
  // again. Nothing where the output is no terminal.
  void clear();

  // Draws the last state, however recently one was drawn, and ends the line. Further calls of
  // anything do nothing.
  void finish();

  double elapsed_seconds() const { return clock_() - start_; }

 private:
  std::string line(double now) const;
  void draw(double now);

  std::string title_, text_;
  ProgressStyle style_;
  Clock clock_;
  Write write_;
  double start_ = 0;
  double fraction_ = 0;
  std::optional<double> seconds_left_;
  double last_drawn_ = -1e300;
  double last_fraction_ = 0;
  bool updated_ = false;  // something to draw
  bool on_screen_ = false;
  bool drawn_current_ = false;
  bool finished_ = false;
};

}  // namespace nerf
