// What of a grid training changes with its progress, and what that saves.
#include <algorithm>
#include <cmath>

#include "train/grid_trainer.h"
#include "train/lap.h"

namespace nerf {

namespace {

// Network samples after which every step of a bounded scene takes exact rays: 3000 steps of the
// default batch.
constexpr double kSamplesUntilSharp = 2e8;

}  // namespace

AdamStep GridTrainer::adam_at(int64_t step) const {
  const double progress = progress_at(step);
  return {.rate = rate_at(step),
          .beta1 = static_cast<Real>(
              std::lerp(options.grid_recipe.beta1, options.grid_recipe.final_beta1, progress)),
          .beta2 = static_cast<Real>(
              std::lerp(options.grid_recipe.beta2, options.grid_recipe.final_beta2, progress))};
}

Real GridTrainer::samples_per_cell_at(int64_t step) const {
  return samples_per_cell_at(step, options.plan());
}

Real GridTrainer::samples_per_cell_at(int64_t step, const TrainingPlan& plan) const {
  // Squared: exact rays pay only once the field is sharp. When a bounded scene is does not depend
  // on how long the run goes on after that; an unbounded one gains from more rays to the end.
  double progress = plan.progress_at(step);
  if (!field.unbounded) {
    const double seen = static_cast<double>(step) * options.grid_recipe.batch_samples;
    progress = std::max(progress, std::min(1.0, seen / kSamplesUntilSharp));
  }
  return options.grid.sampler.samples_per_cell *
         static_cast<Real>(std::lerp(options.grid_recipe.early_samples, 1.0, progress * progress));
}

double GridTrainer::late_saving_seconds() {
  constexpr int kRepeats = 3;
  const double capacity = static_cast<double>(batch.max_chunks) * kChunkSamples;
  const Real late = options.grid.sampler.samples_per_cell;
  const double rays_now = capacity / std::max(samples_per_ray, 0.05);
  struct Seconds {
    double draw = 1e30, encode = 1e30;  // the least of the repeats
  } of[2];
  double rays = rays_now;
  int64_t step = done;
  for (const Real samples : {samples_per_cell_at(done), late}) {
    Seconds& least = of[samples == late];
    for (int i = 0; i < kRepeats; ++i) {
      const double begin = seconds_now();
      // Other rays each time: the same again would find their photos' memory in a cache.
      maker.fill(seed(), step++, static_cast<int64_t>(rays), samples, batch);
      const double drawn = seconds_now();
      look_up();
      least.draw = std::min(least.draw, drawn - begin);
      least.encode = std::min(least.encode, seconds_now() - drawn);
      rays = std::min(capacity, capacity * static_cast<double>(batch.rays_considered) /
                                    static_cast<double>(std::max<int64_t>(batch.total_samples, 1)));
    }
  }
  if (of[0].draw == 1e30) return 0;  // steps are late ones already
  // Fewer rays of more samples each need fewer colours: on lego as the root of their number.
  const double colours =
      colour_seconds() * (1 - std::sqrt(std::min(1.0, rays / std::max(rays_now, 1.0))));
  // Their samples share more of the table's rows, which gradients and optimiser gain by as lookups
  // do.
  const double lookups = of[0].encode - of[1].encode;
  const double table = table_seconds * lookups / of[0].encode;
  return of[0].draw - of[1].draw + colours + lookups + table;
}

double GridTrainer::colour_seconds() const {
  if (options.grid_recipe.shared_colour <= 0) return 0;
  const auto products = [](const std::vector<LinearWeights>& layers) {
    double sum = 0;
    for (const LinearWeights& w : layers) sum += static_cast<double>(w.in) * w.out;
    return sum;
  };
  // By the multiply-adds of both networks.
  const double density = products(field.density_layers);
  const double colour = colours_per_sample * products(field.colour_layers);
  return chunk_seconds * colour / (density + colour);
}

double GridTrainer::late_saving_share(int64_t steps) const {
  // What drawing costs is proportional to the number of rays that a batch has room for; the part
  // that colours have in the saving comes a little sooner.
  const TrainingPlan plan = options.plan().changed(done, steps);
  const auto rays = [&](int64_t step) {
    return 1 / static_cast<double>(samples_per_cell_at(step, plan));
  };
  const double now = rays(done), last = rays(steps);
  if (!(now > last)) return 1;
  constexpr int kParts = 64;
  double sum = 0;
  for (int i = 0; i < kParts; ++i)
    sum += now - rays(done + (std::max(steps, done) - done) * (2 * i + 1) / (2 * kParts));
  return std::clamp(sum / kParts / (now - last), 0.0, 1.0);
}

}  // namespace nerf
