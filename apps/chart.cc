#include "chart.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>

namespace nerf::apps {
namespace {

constexpr double kWidth = 860, kHeight = 470;
constexpr double kLeft = 84, kTop = 48, kBottom = 62, kLegend = 240;  // margins
constexpr double kRight = kWidth - kLegend, kBase = kHeight - kBottom;
constexpr double kLetter = 6.4, kLine = 13;  // of labels, pixels

// Okabe and Ito's colours, told apart by most eyes; yellow is too light for lines.
constexpr std::array kColours = {"#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#444444"};

struct Extent {
  double low = 0, high = 1;
};

// One axis: values to pixels.
class Scale {
 public:
  Scale(const ChartAxis& axis, std::vector<double> values, double from, double to)
      : axis_(axis), from_(from), to_(to) {
    std::erase_if(values, [&](double v) { return !drawable(v); });
    if (values.empty()) values = {axis.log ? 0.1 : 0.0, 1.0};
    const auto [least, most] = std::minmax_element(values.begin(), values.end());
    extent_ = {at(*least), at(*most)};
    const double length = extent_.high - extent_.low;
    const double margin = length > 0 ? 0.06 * length : std::max(0.5, 0.1 * std::abs(extent_.low));
    // A linear axis of values from 0 on begins at 0.
    const bool at_zero = !axis.log && *least >= 0 && *least < 0.35 * *most;
    extent_.low = at_zero ? 0 : extent_.low - margin;
    extent_.high += margin;
  }
  bool drawable(double v) const { return std::isfinite(v) && (!axis_.log || v > 0); }
  double pixel(double v) const {
    return from_ + (at(v) - extent_.low) / (extent_.high - extent_.low) * (to_ - from_);
  }
  std::vector<double> ticks() const {
    if (axis_.ticks.empty()) return axis_ticks(value(extent_.low), value(extent_.high), axis_.log);
    std::vector<double> within;
    for (const double t : axis_.ticks)
      if (drawable(t) && at(t) >= extent_.low && at(t) <= extent_.high) within.push_back(t);
    return within;
  }

 private:
  double at(double v) const { return axis_.log ? std::log10(v) : v; }
  double value(double at) const { return axis_.log ? std::pow(10, at) : at; }
  const ChartAxis& axis_;
  double from_, to_;
  Extent extent_;
};

std::string superscript(int n) {
  static constexpr std::array kDigits = {"⁰", "¹", "²", "³", "⁴", "⁵", "⁶", "⁷", "⁸", "⁹"};
  std::string out = n < 0 ? "⁻" : "";
  for (const char c : std::to_string(std::abs(n))) out += kDigits[static_cast<size_t>(c - '0')];
  return out;
}

std::string tick_text(double v, bool log) {
  if (std::abs(v) < 1e-12) return "0";
  if (log && (v < 9.9e-5 || v > 1.01e5)) {
    const int power = static_cast<int>(std::floor(std::log10(v) + 1e-9));
    const double factor = v / std::pow(10, power);
    const std::string ten = "10" + superscript(power);
    return std::abs(factor - 1) < 1e-6 ? ten : fmt::format("{:.0f}·{}", factor, ten);
  }
  return fmt::format("{:.6g}", v);
}

struct Rectangle {
  double x0, y0, x1, y1;
  double overlap(const Rectangle& o) const {
    const double w = std::min(x1, o.x1) - std::max(x0, o.x0);
    const double h = std::min(y1, o.y1) - std::max(y0, o.y0);
    return w > 0 && h > 0 ? w * h : 0;
  }
};

std::string marker(size_t series, double x, double y) {
  const char* colour = kColours[series % kColours.size()];
  const auto polygon = [&](const std::string& points) {
    return fmt::format("<polygon points=\"{}\" fill=\"{}\"/>\n", points, colour);
  };
  switch (series % 4) {
    case 0:
      return fmt::format("<circle cx=\"{:.1f}\" cy=\"{:.1f}\" r=\"4\" fill=\"{}\"/>\n", x, y,
                         colour);
    case 1:
      return fmt::format(
          "<rect x=\"{:.1f}\" y=\"{:.1f}\" width=\"7.4\" height=\"7.4\" fill=\"{}\"/>\n", x - 3.7,
          y - 3.7, colour);
    case 2:
      return polygon(fmt::format("{:.1f},{:.1f} {:.1f},{:.1f} {:.1f},{:.1f} {:.1f},{:.1f}", x,
                                 y - 5.3, x + 5.3, y, x, y + 5.3, x - 5.3, y));
    default:
      return polygon(fmt::format("{:.1f},{:.1f} {:.1f},{:.1f} {:.1f},{:.1f}", x, y - 5.2, x + 4.8,
                                 y + 3.6, x - 4.8, y + 3.6));
  }
}

std::string text_at(double x, double y, const std::string& anchor, const std::string& text,
                    const std::string& more = "") {
  return fmt::format("<text x=\"{:.1f}\" y=\"{:.1f}\" text-anchor=\"{}\"{}{}>{}</text>\n", x, y,
                     anchor, more.empty() ? "" : " ", more, xml_escaped(text));
}

class Drawing {
 public:
  explicit Drawing(const Chart& chart)
      : chart_(chart),
        x_(chart.x, values(&ChartPoint::x, chart.x_mark), kLeft, kRight),
        y_(chart.y, values(&ChartPoint::y, {}), kBase, kTop) {}

  std::string text() {
    out_ = fmt::format(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {0} {1}\" width=\"{0}\" "
        "height=\"{1}\" font-family=\"DejaVu Sans, Verdana, Arial, sans-serif\" font-size=\"12\" "
        "fill=\"#222222\">\n<rect width=\"{0}\" height=\"{1}\" fill=\"#ffffff\"/>\n",
        kWidth, std::max(kHeight, legend_at(chart_.series.size())));
    out_ += text_at(kLeft, 26, "start", chart_.title, "font-size=\"15\" font-weight=\"bold\"");
    axes();
    mark();
    for (size_t s = 0; s < chart_.series.size(); ++s) series(s);
    labels();
    legend();
    return out_ + "</svg>\n";
  }

 private:
  std::vector<double> values(double ChartPoint::* member, std::optional<double> more) const {
    std::vector<double> out;
    for (const ChartSeries& s : chart_.series)
      for (const ChartPoint& p : s.points) out.push_back(p.*member);
    if (more) out.push_back(*more);
    return out;
  }

  void line(double x0, double y0, double x1, double y1, const std::string& style) {
    out_ += fmt::format("<line x1=\"{:.1f}\" y1=\"{:.1f}\" x2=\"{:.1f}\" y2=\"{:.1f}\" {}/>\n", x0,
                        y0, x1, y1, style);
  }

  void axes() {
    const std::string grid = "stroke=\"#e4e4e4\"", frame = "stroke=\"#555555\"";
    for (const double t : x_.ticks()) {
      line(x_.pixel(t), kTop, x_.pixel(t), kBase, grid);
      out_ += text_at(x_.pixel(t), kBase + 19, "middle", tick_text(t, chart_.x.log));
    }
    for (const double t : y_.ticks()) {
      line(kLeft, y_.pixel(t), kRight, y_.pixel(t), grid);
      out_ += text_at(kLeft - 8, y_.pixel(t) + 4, "end", tick_text(t, chart_.y.log));
    }
    line(kLeft, kBase, kRight, kBase, frame);
    line(kLeft, kTop, kLeft, kBase, frame);
    out_ +=
        text_at((kLeft + kRight) / 2, kHeight - 16, "middle", chart_.x.title, "font-size=\"13\"");
    const double middle = (kTop + kBase) / 2;
    out_ += text_at(20, middle, "middle", chart_.y.title,
                    fmt::format("font-size=\"13\" transform=\"rotate(-90 20 {:.1f})\"", middle));
  }

  void mark() {
    if (!chart_.x_mark || !x_.drawable(*chart_.x_mark)) return;
    const double x = x_.pixel(*chart_.x_mark);
    line(x, kTop, x, kBase, "stroke=\"#777777\" stroke-dasharray=\"5 4\"");
    const bool left = x > (kLeft + kRight) / 2;
    const double wide = kLetter * static_cast<double>(chart_.x_mark_label.size());
    const double from = left ? x - 6 - wide : x + 6;
    taken_.push_back({from, kTop, from + wide, kTop + 2 * kLine});
    out_ += text_at(left ? x - 6 : x + 6, kTop + 14, left ? "end" : "start", chart_.x_mark_label,
                    "fill=\"#555555\"");
  }

  bool drawable(const ChartPoint& p) const { return x_.drawable(p.x) && y_.drawable(p.y); }

  void series(size_t index) {
    const ChartSeries& s = chart_.series[index];
    std::string path;
    for (const ChartPoint& p : s.points)
      if (drawable(p)) path += fmt::format("{:.1f},{:.1f} ", x_.pixel(p.x), y_.pixel(p.y));
    if (s.line && !path.empty())
      out_ += fmt::format(
          "<polyline points=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"2\" "
          "stroke-linejoin=\"round\"/>\n",
          path, kColours[index % kColours.size()]);
    for (const ChartPoint& p : s.points) {
      if (!drawable(p)) continue;
      const double x = x_.pixel(p.x), y = y_.pixel(p.y);
      if (s.line && &p != &s.points.front()) keep_clear_of_line(*(&p - 1), p);
      if (!s.markers) continue;
      taken_.push_back({x - 5, y - 5, x + 5, y + 5});
      out_ += marker(index, x, y);
    }
  }

  void keep_clear_of_line(const ChartPoint& from, const ChartPoint& to) {
    if (!drawable(from)) return;
    const double x0 = x_.pixel(from.x), y0 = y_.pixel(from.y);
    const double dx = x_.pixel(to.x) - x0, dy = y_.pixel(to.y) - y0;
    const int pieces = 1 + static_cast<int>(std::hypot(dx, dy) / 4);
    for (int i = 0; i < pieces; ++i) {
      const double x = x0 + dx * i / pieces, y = y0 + dy * i / pieces;
      taken_.push_back({x - 1.5, y - 1.5, x + 1.5, y + 1.5});
    }
  }

  // Each label at that of eight places around its point which covers least.
  void labels() {
    for (size_t s = 0; s < chart_.series.size(); ++s)
      for (const ChartPoint& p : chart_.series[s].points)
        if (drawable(p) && !p.label.empty()) label(p, kColours[s % kColours.size()]);
  }

  void label(const ChartPoint& p, const char* colour) {
    const double x = x_.pixel(p.x), y = y_.pixel(p.y);
    const double w = kLetter * static_cast<double>(p.label.size());
    Rectangle best{};
    double least = 1e30, distance = 0;
    for (const double far : {8.0, 16.0, 26.0})
      for (const auto& [dx, dy] :
           {std::pair{1, 0}, {-1, 0}, {0, -1}, {0, 1}, {1, -1}, {-1, -1}, {1, 1}, {-1, 1}}) {
        const double cx = x + dx * (far + w / 2) * (dy && dx ? 0.9 : 1);
        const double cy = y + dy * (far + kLine / 2);
        const Rectangle r{cx - w / 2, cy - kLine / 2, cx + w / 2, cy + kLine / 2};
        double covered = 2 * far;  // near places first
        for (const Rectangle& t : taken_) covered += r.overlap(t);
        if (r.x0 < kLeft + 2 || r.x1 > kRight || r.y0 < kTop || r.y1 > kBase - 2) covered += 1e4;
        if (covered < least) {
          least = covered;
          best = r;
          distance = far;
        }
      }
    taken_.push_back(best);
    if (distance > 8)  // so far off that it might be another point's
      line(x, y, std::clamp(x, best.x0, best.x1), std::clamp(y, best.y0 + 2, best.y1 - 2),
           fmt::format("stroke=\"{}\" stroke-width=\"0.8\"", colour));
    // A halo, then the text over it: programs that do not know paint-order would hide the text.
    for (const std::string& style :
         {std::string("fill=\"#ffffff\" stroke=\"#ffffff\" stroke-width=\"3\""),
          fmt::format("fill=\"{}\"", colour)})
      out_ += text_at((best.x0 + best.x1) / 2, best.y1 - 3, "middle", p.label,
                      "font-size=\"11\" " + style);
  }

  static double legend_at(size_t series) { return kTop + 8 + 22 * static_cast<double>(series); }

  void legend() {
    for (size_t s = 0; s < chart_.series.size(); ++s) {
      const double y = legend_at(s);
      if (chart_.series[s].line)
        line(kRight + 16, y, kRight + 42, y,
             fmt::format("stroke=\"{}\" stroke-width=\"2\"", kColours[s % kColours.size()]));
      if (chart_.series[s].markers) out_ += marker(s, kRight + 29, y);
      out_ += text_at(kRight + 50, y + 4, "start", chart_.series[s].name);
    }
  }

  const Chart& chart_;
  Scale x_, y_;
  std::string out_;
  std::vector<Rectangle> taken_;
};

}  // namespace

std::vector<double> axis_ticks(double low, double high, bool log) {
  std::vector<double> ticks;
  const double decades = log ? std::log10(high / low) : 0;
  if (decades > 0.4) {
    const std::vector<double> factors = decades < 1.3   ? std::vector{1.0, 1.5, 2.0, 3.0, 5.0, 7.0}
                                        : decades < 2.5 ? std::vector{1.0, 2.0, 5.0}
                                                        : std::vector{1.0};
    const int every = std::max(1, static_cast<int>(std::ceil(decades / 8)));
    const int last = static_cast<int>(std::ceil(std::log10(high)));
    for (int e = static_cast<int>(std::floor(std::log10(low))); e <= last; ++e)
      for (const double factor : factors) {
        const double t = factor * std::pow(10, e);
        if (e % every == 0 && t >= low && t <= high) ticks.push_back(t);
      }
    return ticks;
  }
  const double rough = (high - low) / 8;
  const double power = std::pow(10, std::floor(std::log10(rough)));
  double step = 10 * power;
  for (const double factor : {5.0, 2.0, 1.0})
    if (factor * power >= rough) step = factor * power;
  for (double k = std::ceil(low / step); k * step <= high + 1e-9 * step; ++k)
    ticks.push_back(k * step);
  return ticks;
}

std::string xml_escaped(const std::string& text) {
  std::string out;
  for (const char c : text) {
    switch (c) {
      case '&':
        out += "&amp;";
        break;
      case '<':
        out += "&lt;";
        break;
      case '>':
        out += "&gt;";
        break;
      case '"':
        out += "&quot;";
        break;
      default:
        out += c;
    }
  }
  return out;
}

std::string svg_text(const Chart& chart) { return Drawing(chart).text(); }

}  // namespace nerf::apps
