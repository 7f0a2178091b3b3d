// Triangles of a field's surface.
#include <algorithm>
#include <cmath>
#include <memory>
#include <string>

#include "nerf/base/error.h"
#include "nerf/geometry/marching_cubes.h"
#include "nerf/model/field.h"
#include "nerf/model/integrator.h"
#include "nerf/model/radiance_field.h"
#include "nerf/model/surface.h"

namespace nerf {

namespace {

constexpr int kSide = VoxelVolume::kSide;

double voxel_of(const SurfaceRegion& region, const SurfaceOptions& options) {
  const Vec3d size = region.box.size();
  return std::max({size.x, size.y, size.z}) / options.resolution;
}

template <class Body>  // body(sample, i, j, k of the lattice)
void each_sample(const VoxelVolume& volume, const std::array<int, 3>& block, const Body& body) {
  const std::array<int, 3>& samples = volume.lattice().samples;
  int s = 0;
  for (int z = 0; z < kSide; ++z)
    for (int y = 0; y < kSide; ++y)
      for (int x = 0; x < kSide; ++x, ++s) {
        const int i = block[0] * kSide + x, j = block[1] * kSide + y, k = block[2] * kSide + z;
        if (i < samples[0] && j < samples[1] && k < samples[2])
          body(static_cast<size_t>(s), i, j, k);
      }
}

// Blocks with a sample that may hold matter, and those around them.
std::vector<uint8_t> blocks_with_matter(const Field& field, const SurfaceRegion& region,
                                        const VoxelVolume& volume, const SurfaceWork& work) {
  const auto [nx, ny, nz] = volume.blocks_along();
  std::vector<uint8_t> hit(static_cast<size_t>(volume.block_count())), wanted = hit;
  work.pool.parallel_for(nz, [&](int64_t z) {
    for (int y = 0; y < ny; ++y)
      for (int x = 0; x < nx; ++x) {
        const std::array<int, 3> at{x, y, static_cast<int>(z)};
        bool any = false;
        each_sample(volume, at, [&](size_t, int i, int j, int k) {
          any = any || field.may_hold(region.to_engine(volume.lattice().position(i, j, k)));
        });
        hit[static_cast<size_t>(volume.block_index(at[0], at[1], at[2]))] = any;
      }
  });
  for (int z = 0; z < nz; ++z)
    for (int y = 0; y < ny; ++y)
      for (int x = 0; x < nx; ++x) {
        if (!hit[static_cast<size_t>(volume.block_index(x, y, z))]) continue;
        for (int k = std::max(0, z - 1); k <= std::min(nz - 1, z + 1); ++k)
          for (int j = std::max(0, y - 1); j <= std::min(ny - 1, y + 1); ++j)
            for (int i = std::max(0, x - 1); i <= std::min(nx - 1, x + 1); ++i)
              wanted[static_cast<size_t>(volume.block_index(i, j, k))] = 1;
      }
  return wanted;
}

// Logarithms of the density: it grows by orders of magnitude within a voxel, and between two
// samples the surface is where their straight line crosses.
void ask_densities(const RadianceField& radiance, const SurfaceRegion& region, double threshold,
                   const SurfaceOptions& options, const SurfaceWork& work, VoxelVolume& volume) {
  constexpr double kMost = 4;  // of a value
  const Field& field = radiance.field();
  auto& blocks = volume.blocks();
  std::vector<std::unique_ptr<FieldQuery>> queries(static_cast<size_t>(work.pool.size()));
  work.pool.parallel_for_thread(static_cast<int64_t>(blocks.size()), [&](int64_t b, int thread) {
    if (work.cancel && work.cancel->requested()) throw Cancelled();
    auto& query = queries[static_cast<size_t>(thread)];
    if (!query) query = field.query(nullptr);
    VoxelVolume::Block& block = blocks[static_cast<size_t>(b)];
    std::vector<Vec3d> positions;
    std::vector<size_t> of;
    each_sample(volume, block.at, [&](size_t s, int i, int j, int k) {
      block.weight[s] = 1;
      block.value[s] = static_cast<float>(kMost);
      const Vec3d p = region.to_engine(volume.lattice().position(i, j, k));
      if (!field.may_hold(p)) return;
      positions.push_back(p);
      of.push_back(s);
    });
    std::vector<Real> density(positions.size());
    if (!positions.empty()) query->ask({positions, {}, options.render.time}, {density, {}, {}});
    for (size_t i = 0; i < of.size(); ++i)
      block.value[of[i]] = static_cast<float>(std::clamp(
          std::log(threshold / std::max(static_cast<double>(density[i]), 1e-30)), -kMost, kMost));
  });
}

}  // namespace

TriangleMesh mesh_from_depth(const SurfaceRegion& region, std::span<const DepthView> views,
                             const SurfaceOptions& options, const SurfaceWork& work) {
  const VoxelLattice lattice = VoxelLattice::around(region.box, options.resolution);
  FusionOptions fusion;
  fusion.truncation = options.truncation * lattice.spacing;
  const VoxelVolume volume =
      fuse_depths(views, lattice, fusion, work.memory_bytes, work.pool, work.cancel);
  TriangleMesh mesh = marching_cubes(volume, work.pool);
  find_normals(mesh);
  return mesh;
}

TriangleMesh mesh_from_density(const RadianceField& field, const SurfaceRegion& region,
                               std::span<const DepthView> views, const SurfaceOptions& options,
                               const SurfaceWork& work) {
  const double threshold =
      options.density > 0 ? options.density
                          : std::log(2.0) / (options.density_voxels * voxel_of(region, options));
  VoxelVolume volume(VoxelLattice::around(region.box, options.resolution));
  const auto wanted = blocks_with_matter(field.field(), region, volume, work);
  const int64_t blocks = std::count(wanted.begin(), wanted.end(), 1);
  if (2 * VoxelVolume::bytes_of(blocks) > work.memory_bytes)
    throw Error(
        "the surface's volume needs " + std::to_string(2 * VoxelVolume::bytes_of(blocks) >> 20) +
            " MB of memory, and " + std::to_string(work.memory_bytes >> 20) + " MB are there",
        "--resolution", "give a smaller one, or a smaller --bbox");
  volume.allocate(wanted);
  ask_densities(field, region, threshold, options, work, volume);
  if (!views.empty()) {
    // What no view sees is not known.
    carve_unseen(views, options.truncation * volume.lattice().spacing, volume, work.pool,
                 work.cancel);
  }
  TriangleMesh mesh = marching_cubes(volume, work.pool);
  find_normals(mesh);
  return mesh;
}

std::vector<Vec3> surface_colours(const RadianceField& field, const SurfaceRegion& region,
                                  std::span<const DepthView> views, std::span<const Vec3> positions,
                                  std::span<const Vec3> normals, double width,
                                  const SurfaceOptions& options, const SurfaceWork& work) {
  const size_t n = positions.size();
  NERF_CHECK_EQ(normals.size(), n);
  const std::vector<Vec3d> towards =
      mean_view_directions(views, positions, normals, width, work.pool);
  std::vector<Ray> rays(n);
  std::vector<Vec3d> at(n), along(n);
  for (size_t i = 0; i < n; ++i) {
    at[i] = region.to_engine(positions[i].cast<double>());
    along[i] = -region.to_engine(towards[i]);
    rays[i].origin = at[i] - along[i] * width;
    rays[i].direction = along[i];
    rays[i].far = 2 * width;
    rays[i].time = options.render.time;
  }
  const RayResults seen =
      integrate(field, rays, {}, options.render, work.pool, work.progress, work.cancel);
  std::vector<Vec3> colours(n);
  constexpr Real kLeast = 0.05_r;  // of opacity
  std::vector<size_t> bare;
  for (size_t i = 0; i < n; ++i) {
    if (seen.opacity[i] < kLeast) bare.push_back(i);
    for (int k = 0; k < 3; ++k)
      colours[i][k] =
          std::clamp(seen.rgb[3 * i + static_cast<size_t>(k)] / std::max(seen.opacity[i], kLeast),
                     0.0_r, 1.0_r);
  }
  // Hardly any matter within the width: what colour it would have.
  std::vector<Vec3d> bare_at, bare_along;
  for (const size_t i : bare) {
    bare_at.push_back(at[i]);
    bare_along.push_back(along[i]);
  }
  std::vector<Real> rgb(3 * bare.size());
  if (!bare.empty())
    field.field().query(nullptr)->ask({bare_at, bare_along, options.render.time}, {{}, rgb, {}});
  for (size_t i = 0; i < bare.size(); ++i)
    colours[bare[i]] = {rgb[3 * i], rgb[3 * i + 1], rgb[3 * i + 2]};
  return colours;
}

}  // namespace nerf
