// What a checkpoint keeps of the grid method's trainer.
#include <algorithm>
#include <nlohmann/json.hpp>
#include <type_traits>
#include <vector>

#include "train/grid_trainer.h"

namespace nerf {

namespace {

// Every array that a step reads and the step before wrote, but for the table and its rows' states.
// Gradients and marks are zero between steps.
template <class T, class Visit>
void visit_arrays(T& t, Visit&& visit) {
  visit("networks", t.field.weights.span());
  visit("networks_m", t.dense->m.span());
  visit("networks_v", t.dense->v.span());
  visit("opacity", t.field.occupancy.training_state());
  if (t.moving) visit("opacity_most", t.field.occupancy.moments_state());
  if (t.cameras) CameraRefinement::visit_arrays(*t.cameras, visit);
  if (t.robust) RobustMask::visit_arrays(*t.robust, visit);
}
constexpr const char* kLevels = "occupancy";  // as of its last rebuild

// The table, and of the states of all rows part by part: of the moments a number for each feature,
// of the steps one.
template <class T, class Visit>
void visit_rows(T& t, Visit&& visit) {
  auto* states = t.optimiser.row_states.data();
  const size_t features = static_cast<size_t>(t.optimiser.features);
  const auto part = [&](RowPart part, size_t count) {
    return internal::Strided<std::remove_pointer_t<decltype(states)>>{
        states + part * features, t.optimiser.rows, count, kRowParts * features};
  };
  if (t.field.options.table_bits == 16)
    visit("table", part(kRowWeights, features));
  else
    visit("table", t.field.table.span());
  visit("table_m", part(kRowM, features));
  visit("table_v", part(kRowV, features));
  visit("row_steps", part(kRowSteps, 1));
}

}  // namespace

void GridTrainer::save_state(internal::ContainerWriter& file,
                             nlohmann::ordered_json& scalars) const {
  scalars["samples_per_ray"] = samples_per_ray;
  visit_arrays(*this, [&](const char* name, auto values) {
    file.add(name, std::span<const typename decltype(values)::value_type>(values));
  });
  visit_rows(*this, [&](const char* name, auto states) { file.add(name, states); });
  file.add(kLevels, field.occupancy.levels(), internal::SectionEncoding::kZlib);
}

void GridTrainer::load_state(const internal::ContainerReader& file,
                             const internal::JsonFields& scalars) {
  std::vector<uint8_t> levels(field.occupancy.levels().size());
  file.read(kLevels, std::span(levels));
  std::ranges::fill(optimiser.table_gradient, 0.0_r);
  std::ranges::fill(optimiser.marks, uint8_t{0});
  visit_arrays(*this, [&](const char* name, auto values) { file.read(name, values); });
  visit_rows(*this, [&](const char* name, auto states) { file.read(name, states); });
  if (cameras) cameras->apply();
  optimiser.give_weights(field);
  field.occupancy.set_levels(levels);
  samples_per_ray = scalars.number("samples_per_ray");
  if (robust) robust->find_threshold(progress_at(std::max<int64_t>(done - 1, 0)));
  dense->pack(options.precision, pool);
}

}  // namespace nerf
