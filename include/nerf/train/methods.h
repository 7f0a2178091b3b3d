// The one table of methods: what each paper's method consists of, and how it is trained.
#pragma once

#include <array>
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

// Every option as the method's preset has it. The grid method has one preset. Throws Error for an
// unknown name.
TrainOptions method_options(const std::string& method, Scale scale);

// The table for a person: a row per method, made from the options that build the models.
std::string methods_table();

}  // namespace nerf
