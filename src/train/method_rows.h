// The rows of the table of methods: what builds a method's options and what prints the table.
#pragma once

#include <span>
#include <string>

#include "nerf/train/methods.h"

namespace nerf::internal {

struct MethodRow {
  const char* name;
  const char* source;
  // Fills in the publication's setting.
  void (*paper)(TrainOptions&);
};

std::span<const MethodRow> method_rows();

// What `row` says at a scale.
TrainOptions options_of(const MethodRow& row, Scale scale);

// The grid method's line and one for each row, from the options that options_of() makes.
std::string table_of(std::span<const MethodRow> rows);

}  // namespace nerf::internal
