// The subcommands of nerf_bench; argv[0] is the subcommand.
#pragma once

namespace nerf::apps {

int bench_scene(int argc, char** argv);
int bench_kernels(int argc, char** argv);

}  // namespace nerf::apps
