// The one table of methods: what each paper's method consists of, and how it is trained.
#pragma once

#include <array>
#include <set>
#include <string>
#include <vector>

#include "nerf/base/options.h"
#include "nerf/train/trainer.h"

namespace nerf {

// How much a method's preset asks of the machine.
enum class Scale {
  kTiny,   // minutes; for a first look and for tests
  kSmall,  // under an hour on two cores
  kPaper,  // the publication's setting
};
inline auto option_names(Scale) {
  return std::array{OptionName{Scale::kTiny, "tiny"}, OptionName{Scale::kSmall, "small"},
                    OptionName{Scale::kPaper, "paper"}};
}

// Names that TrainOptions::method takes, in the table's order.
std::vector<std::string> method_names();

// Every option as the method's preset has it. All of these throw Error for an unknown name.
TrainOptions method_options(const std::string& method, Scale scale);
// Whether presets differ with the scale.
bool has_scales(const std::string& method);
// Length of a training that is given neither minutes nor steps.
double default_minutes(const std::string& method, Scale scale);
// Whether the method reads the training option of that name (as in OptionField::name).
bool reads_option(const std::string& method, const std::string& option);
// A line for each of the `given` options (names) that has no effect with this method on this scene.
std::vector<std::string> unused_options(const TrainOptions& options,
                                        const std::set<std::string>& given, const Scene& scene);
// Whether a step depends on how long the training will be, not on the share of it that is done.
bool depends_on_length(const TrainOptions& options);
// Whether the method trains on photos at smaller scales too (photo_scales.h): the paper methods do,
// as in mip-NeRF's comparison (Barron et al. 2021, section 5). To the grid's points a reduced photo
// says nothing that the full one does not.
bool learns_from_reduced_photos(const TrainOptions& options);

// The table for a person: a row per method, made from the options that build the models.
std::string methods_table();

}  // namespace nerf
