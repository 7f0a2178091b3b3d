// Quadrature error against evaluations per ray.
#include <fmt/format.h>

#include <cmath>

#include "app.h"
#include "error_bench.h"
#include "quadrature.h"

namespace nerf::apps {
namespace {

const char* medium_title(MediumKind kind) {
  switch (kind) {
    case MediumKind::kHomogeneous:
      return "Homogeneous medium, colour linear in depth";
    case MediumKind::kExponential:
      return "Density and colour that fall off exponentially";
    case MediumKind::kSlab:
      return "Slab with sharp faces";
    case MediumKind::kTwoLayers:
      return "Two layers with sharp faces";
  }
  return "";
}

}  // namespace

ErrorCurve quadrature_curve(const ErrorBenchOptions& options, ThreadPool& pool) {
  ErrorCurve curve;
  curve.name = "quadrature";
  curve.title = "Quadrature: error against evaluations per ray";
  curve.text = fmt::format(
      "Volume rendering of media whose light is known in closed form, in double precision: root "
      "of the mean squared error of a pixel (colours from 0 to 1) over {} random rays from depth "
      "{} to {}. Hierarchical sampling spends half of the evaluations on the distribution that "
      "the other half is placed by. The order is the slope against the row before: 2 means that "
      "twice the samples leave a quarter of the error.",
      options.rays, kNear, kFar);
  curve.table.columns = {"medium", "sampling", "evaluations", "rms_error", "order", "command"};
  for (const MediumKind medium : kMediumKinds) {
    Chart chart;
    chart.name = fmt::format("quadrature_{}", medium_name(medium));
    chart.title = medium_title(medium);
    chart.x = {"evaluations per ray", true, {}};
    for (const int n : options.samples_list()) chart.x.ticks.push_back(n);
    chart.y = {"RMS error of a pixel", true, {}};
    for (const Sampling sampling : kSamplings) {
      const std::string name = fmt::format("{}, {}", medium_name(medium), sampling_name(sampling));
      if (!options.selected(name)) continue;
      ChartSeries series{sampling_name(sampling), {}, true};
      for (const int n : options.samples_list()) {
        const double error =
            quadrature_error(medium, sampling, n, options.rays, options.seed, pool);
        std::string order;
        if (!series.points.empty()) {
          const ChartPoint& before = series.points.back();
          if (error > 0 && before.y > 0)
            order = fmt::format("{:.3f}", std::log(before.y / error) / std::log(n / before.x));
        }
        series.points.push_back({static_cast<double>(n), error, ""});
        curve.table.rows.push_back(
            {medium_name(medium), sampling_name(sampling), std::to_string(n),
             fmt::format("{:.6e}", error), order,
             fmt::format("nerf_bench error --curves quadrature --samples {} --rays {} --seed {} "
                         "--filter {} -o {}",
                         n, options.rays, options.seed, shell_quoted("=" + name),
                         options.out_again())});
      }
      chart.series.push_back(std::move(series));
    }
    if (!chart.series.empty()) curve.charts.push_back(std::move(chart));
  }
  return curve;
}

}  // namespace nerf::apps
