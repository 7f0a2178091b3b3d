// Throughput of the kernels beside what the machine reaches at most, both measured in one run.
#include <fmt/format.h>

#include <algorithm>
#include <cstdio>
#include <memory>

#include "app.h"
#include "bench_commands.h"
#include "kernel_bench.h"
#include "nerf/base/file.h"
#include "nerf/kernels/bf16.h"
#include "nerf/kernels/peak.h"
#include "nerf/kernels/simd.h"
#include "options_cli.h"

namespace nerf::apps {
namespace {

struct KernelBenchOptions {
  double seconds = 0.2;
  std::string filter;
  int threads = 0;
  int stream_mb = 1024;
  std::filesystem::path csv;

  template <class V>
  void visit_options(V& v) {
    v("seconds", seconds, "length of each measurement, whose repetitions' median counts", above(0),
      at_most(3600));
    v("filter", filter, "only kernels whose name contains this", metavar("TEXT"));
    v("threads", threads, "the most threads, measured beside one and two; 0 takes all processors",
      at_least(0), at_most(1024));
    v("stream_mb", stream_mb,
      "array that the memory's bandwidth is read from, MB; far larger than the caches", at_least(1),
      at_most(1 << 16));
    v("csv", csv, "also writes the table, one line per measurement", metavar("FILE"));
  }
};

// One column of the table.
struct Setting {
  std::string target;
  Bf16Unit unit;  // kNone: the kernels in f32
  ThreadPool* pool;
  std::unique_ptr<Ceilings> ceilings;
  std::string name() const { return unit == Bf16Unit::kNone ? target : bf16_unit_name(unit); }
};

void use(const Setting& s) {
  force_simd_target(s.target);
  force_bf16_unit(s.unit);
}

struct UnitText {
  const char* name;
  double scale;
};

UnitText unit_text(Unit unit) {
  switch (unit) {
    case Unit::kFlops:
      return {"GFLOP/s", 1e-9};
    case Unit::kBytes:
      return {"GB/s", 1e-9};
    case Unit::kSamples:
      return {"M samples/s", 1e-6};
  }
  return {"", 1};
}

// Three significant digits without an exponent.
std::string figure(double x) {
  return fmt::format("{:.{}f}", x, x >= 99.95 ? 0 : x >= 9.995 ? 1 : 2);
}

class KernelBench {
 public:
  explicit KernelBench(const KernelBenchOptions& options)
      : options_(options), all_(options.threads) {
    for (const int threads : {1, 2})
      if (threads < all_.size()) fewer_.push_back(std::make_unique<ThreadPool>(threads));
  }

  int run() {
    std::vector<KernelCase> cases;
    for (auto group : {network_cases, grid_cases, ray_cases, elementwise_cases, descriptor_cases})
      for (KernelCase& c : group())
        if (c.name.find(options_.filter) != std::string::npos) cases.push_back(std::move(c));
    if (cases.empty())
      throw Error("no kernel's name contains '" + options_.filter + "'", "--filter",
                  "without it all are listed");
    measure_ceilings();
    print_header("kernel");
    for (const KernelCase& c : cases) measure(c);
    force_simd_target("");
    if (least_share_ < 0.9)
      log_warning(
          fmt::format("other programs were running: a measurement had {:.0f} % of its "
                      "processors' time; --csv names the share of each",
                      100 * least_share_));
    if (!options_.csv.empty()) write_file_atomically(options_.csv, csv_);
    return kExitOk;
  }

 private:
  void measure_ceilings() {
    const auto add = [&](const std::string& target, Bf16Unit unit) {
      const auto with = [&](ThreadPool& pool) {
        settings_.push_back({target, unit, &pool, std::make_unique<Ceilings>(pool, seconds())});
      };
      for (const auto& pool : fewer_) with(*pool);
      with(all_);
    };
    for (const std::string& target : simd_targets()) add(target, Bf16Unit::kNone);
    for (const Bf16Unit unit : bf16_units()) add(simd_targets().front(), unit);
    print_header("ceiling");
    ceiling_row("f32 multiply-adds", "GFLOP/s", [](Ceilings& c) { return c.flops() * 1e-9; });
    ceiling_row("read in order, 16 KB a thread", "GB/s",
                [](Ceilings& c) { return c.cached() * 1e-9; });
    ceiling_row(
        "bf16 products", "GFLOP/s", [](Ceilings& c) { return c.bf16_flops() * 1e-9; },
        /*bf16=*/true);
    ceiling_row(fmt::format("read in order, {} MB", options_.stream_mb), "GB/s",
                [this](Ceilings& c) {
                  return c.read(static_cast<uint64_t>(options_.stream_mb) << 20) * 1e-9;
                });
    for (const uint64_t mb : {1, 8, 64})
      ceiling_row(fmt::format("random rows of {} bytes, {} MB", kRowBytes, mb), "M rows/s",
                  [=](Ceilings& c) { return c.random_rows(mb << 20) * 1e-6; });
    std::printf("\n");
  }

  double seconds() const { return options_.seconds; }

  void print_header(const char* first) const {
    std::string titles = fmt::format("| {} | unit |", first), rule = "|---|---|";
    for (const Setting& s : settings_) {
      titles += fmt::format(" {}, {} thread{} |", s.name(), s.pool->size(),
                            s.pool->size() == 1 ? "" : "s");
      rule += "---|";
    }
    std::printf("%s\n%s\n", titles.c_str(), rule.c_str());
    std::fflush(stdout);
  }

  template <class Rate>
  void ceiling_row(const std::string& name, const char* unit, const Rate& rate, bool bf16 = false) {
    std::string row = fmt::format("| {} | {} |", name, unit);
    for (Setting& s : settings_) {
      if (bf16 != (s.unit != Bf16Unit::kNone)) {
        row += " |";
        continue;
      }
      use(s);
      const double value = rate(*s.ceilings);
      row += fmt::format(" {} |", figure(value));
      csv_ += fmt::format("\"ceiling: {}\",{},{},{:.6g},{},,,,,\n", name, s.name(), s.pool->size(),
                          value, unit);
    }
    std::printf("%s\n", row.c_str());
    std::fflush(stdout);
  }

  void measure(const KernelCase& c) {
    const UnitText unit = unit_text(c.unit);
    std::string row = fmt::format("| {} | {}, {} |", c.name, unit.name, c.bound);
    for (Setting& s : settings_) {
      const auto& make = s.unit == Bf16Unit::kNone ? c.make : c.make_bf16;
      if (!make) {
        row += " |";
        continue;
      }
      use(s);
      const KernelRun kernel = make(all_.size());
      const double ceiling = kernel.ceiling(*s.ceilings);
      const Timing timing = time_calls(kernel.prepare, [&] { kernel.run(*s.pool); }, seconds());
      const double rate = kernel.work / timing.median;
      const double share = timing.processors / s.pool->size();
      least_share_ = std::min(least_share_, share);
      // Of samples the bytes as well, which kernels of other kinds are measured in.
      NERF_CHECK((kernel.bytes > 0) == (c.unit == Unit::kSamples));
      const double gigabytes =
          1e-9 * (c.unit == Unit::kBytes ? kernel.work : kernel.bytes) / timing.median;
      row += fmt::format(" {}{} ({:.0f} %) |", figure(rate * unit.scale),
                         c.unit == Unit::kSamples ? ", " + figure(gigabytes) + " GB/s" : "",
                         100 * rate / ceiling);
      csv_ += fmt::format("\"{}\",{},{},{:.6g},{},{},{:.6g},{:.4g},{:.3g},{}\n", c.name, s.name(),
                          s.pool->size(), rate * unit.scale, unit.name, c.bound,
                          ceiling * unit.scale, rate / ceiling, share,
                          c.unit == Unit::kFlops ? "" : fmt::format("{:.6g}", gigabytes));
    }
    std::printf("%s\n", row.c_str());
    std::fflush(stdout);
  }

  const KernelBenchOptions& options_;
  ThreadPool all_;
  std::vector<std::unique_ptr<ThreadPool>> fewer_;  // of one thread and of two
  std::vector<Setting> settings_;
  double least_share_ = 1;
  std::string csv_ =
      "kernel,target,threads,rate,unit,bound,ceiling,fraction,processor_share,gb_per_second\n";
};

}  // namespace

int bench_kernels(int argc, char** argv) {
  KernelBenchOptions options;
  const ProgramText text{
      "nerf_bench kernels",
      "Throughput of the kernels and the share of what the machine reaches at most.",
      "FLOPs are 2 for each multiply-add of the unpadded layers, three times as many forward and\n"
      "backward. Bytes are those that a kernel must read and write, from a cache or not. A sample\n"
      "of the hash grid counts its point, its features and eight rows of each level (backward\n"
      "these are read, written and marked; a gradient by position is read and written too);\n"
      "gradient roulette counts what it reads.\n"
      "A kernel's ceiling, named behind its unit, is measured in the same run with the same\n"
      "instructions and threads. The hash grid's ceiling takes every corner for a random row of\n"
      "its level's table; neighbouring samples share corners, so more than 100 % is possible.\n"
      "Bytes read and written are held against reading as much memory: 200 % means that writing\n"
      "cost no more than reading."};
  if (parse_command_line(argc, argv, text, options).exit) return kExitOk;
  log_machine("nerf_bench kernels", ThreadPool(options.threads).size(), Precision::kAuto);
  return KernelBench(options).run();
}

}  // namespace nerf::apps
