// The table of methods: what builds a method's options, its trainer and its line for a person.
#pragma once

#include <array>
#include <memory>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "nerf/base/threads.h"
#include "nerf/train/methods.h"

namespace nerf {
struct TrainerImpl;
}

namespace nerf::internal {

struct MethodRow;
inline constexpr size_t kMethodColumns = 11;
using MethodLine = std::array<std::string, kMethodColumns>;

// What the methods over one kind of field have in common: the only place that tells kinds apart.
struct MethodFamily {
  bool one_preset;                  // for all scales
  bool learns_from_reduced_photos;  // see methods.h
  bool draws_masked;                // MaskedShare is above 0 unless it is said otherwise
  double (*minutes)(Scale);         // of a training that is given no length
  std::unique_ptr<TrainerImpl> (*make_trainer)(const Scene&, const PhotoSet&, const TrainOptions&,
                                               ThreadPool&);
  uint64_t (*memory_bytes)(const TrainOptions&, bool unbounded, int threads);
  bool (*depends_on_length)(const TrainOptions&);
  // Throws Error for combinations that cannot be.
  void (*check)(const TrainOptions&);
  // Names of the options that no other family reads.
  std::set<std::string> (*own_options)();
  // Appends what was given and has no effect, though the family reads it.
  void (*unused)(const TrainOptions&, const std::set<std::string>& given, const Scene&,
                 std::vector<std::string>& out);
  MethodLine (*line)(const MethodRow&);
};
extern const MethodFamily kGridFamily, kNetworkFamily;

struct MethodRow {
  const char* name;
  const char* source;
  const MethodFamily* family;
  // Fills in the publication's setting.
  void (*paper)(TrainOptions&);
};

std::span<const MethodRow> method_rows();

// Throws Error for an unknown name.
const MethodRow& method_row(const std::string& name);
inline const MethodFamily& family_of(const TrainOptions& options) {
  return *method_row(options.method).family;
}

// What `row` says at a scale.
TrainOptions options_of(const MethodRow& row, Scale scale);

// A heading, then a line for each row, from the options that options_of() makes.
std::string table_of(std::span<const MethodRow> rows);

}  // namespace nerf::internal
