// nerf_bench: the measurements whose figures bench/results holds and docs/benchmarks.md shows.
#include <cstdio>
#include <string>
#include <vector>

#include "app.h"
#include "bench_commands.h"
#include "nerf/base/error.h"
#include "nerf/base/nearest_name.h"

namespace nerf::apps {
namespace {

constexpr const char* kHelp =
    "nerf_bench COMMAND [OPTIONS]\n"
    "  scene SCENE   trains with nerf_train and prints quality over time, throughput, rendering\n"
    "  render RUN    compares a run's held-out views with and without what rendering leaves out\n"
    "  kernels       times the kernels beside what the machine reaches at most\n"
    "  error [SCENE] curves of cost against error: quadrature, training, rendering, width\n"
    "  ablation SCENE  trains a paper's method with one part taken out at a time\n"
    "  report RUN    writes a run's report.html anew, of a stopped run too\n"
    "  tables [FILE] prints kept measurements as Markdown tables\n"
    "nerf_bench COMMAND --help says more.\n";

int bench_main(int argc, char** argv) {
  const std::string command = argc > 1 ? argv[1] : "--help";
  if (command == "--help" || command == "-h") {
    std::fputs(kHelp, stdout);
    return kExitOk;
  }
  if (command == "--version") {
    std::printf("%s\n", version_text("nerf_bench").c_str());
    return kExitOk;
  }
  if (command == "scene") return bench_scene(argc - 1, argv + 1);
  if (command == "render") return bench_render(argc - 1, argv + 1);
  if (command == "kernels") return bench_kernels(argc - 1, argv + 1);
  if (command == "error") return bench_error(argc - 1, argv + 1);
  if (command == "ablation") return bench_ablation(argc - 1, argv + 1);
  if (command == "tables") return bench_tables(argc - 1, argv + 1);
  if (command == "report") return bench_report(argc - 1, argv + 1);
  const std::vector<std::string> known = {"scene",    "render", "kernels", "error",
                                          "ablation", "tables", "report"};
  throw Error("unknown command '" + command + "'", "", nearest_name_hint(command, known));
}

}  // namespace
}  // namespace nerf::apps

int main(int argc, char** argv) {
  return nerf::apps::run_main("nerf_bench", [&] { return nerf::apps::bench_main(argc, argv); });
}
