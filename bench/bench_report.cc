// A run's report, written anew from what its folder holds.
#include <cstdio>

#include "app.h"
#include "bench_commands.h"
#include "options_cli.h"
#include "run_report.h"

namespace nerf::apps {
namespace {

struct ReportOptions {
  std::filesystem::path run;
  int threads = 0;

  template <class V>
  void visit_options(V& v) {
    v("run", run, "folder that nerf_train wrote", positional(), required(), metavar("RUN"));
    v("threads", threads, "threads; 0 takes all processors", at_least(0), at_most(1024));
  }
};

}  // namespace

int bench_report(int argc, char** argv) {
  ReportOptions options;
  const ProgramText text{"nerf_bench report",
                         "Writes RUN/report.html, as nerf_train does at the end of a run.",
                         "Of a run that was stopped it shows what there is and says what is "
                         "missing."};
  if (parse_command_line(argc, argv, text, options).exit) return kExitOk;
  ThreadPool pool(options.threads);
  std::printf("%s\n", write_report(options.run, pool).string().c_str());
  return kExitOk;
}

}  // namespace nerf::apps
