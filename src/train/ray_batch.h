// The rays of a training step, cut into samples and packed into chunks.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "nerf/base/aligned.h"
#include "nerf/base/threads.h"
#include "nerf/io/photos.h"
#include "nerf/io/scene.h"
#include "nerf/math/random.h"
#include "nerf/model/grid_field.h"
#include "nerf/parts/ray_sampler.h"
#include "train/robust_mask.h"
#include "train/sightings.h"
#include "train/skyline.h"

namespace nerf {

// Training pixels and their rays in engine coordinates.
class PixelSource {
 public:
  // sighting_share: of the pixels drawn, those that show a sparse point.
  PixelSource(const Scene& scene, const PhotoSet& photos, double sighting_share = 0);

  struct Pixel {
    Ray ray;
    Real rgb[3] = {};  // straight colour
    Real alpha = 1;
    const Photo* photo = nullptr;
    int x = 0, y = 0;
    Real weight = 1;    // of its error: the area of the pixel
    size_t source = 0;  // the i-th training photo
    const Camera* camera = nullptr;
    const Pose* pose = nullptr;  // camera-to-engine
    double along_axis = 1;       // depth of a ray's unit length
    double distance = 0;         // engine units, by a sparse point or depth map; 0: unknown
    // Transparent, and of no photo; see draw_masked(). Before read(): whether it may be.
    bool masked = false;

    Vec2d centre() const { return {x + 0.5, y + 0.5}; }
    void show(const Sighting& seen) { x = seen.x, y = seen.y, distance = seen.distance; }
  };
  // From now on this share of the pixels that masks leave out is drawn, as transparent ones. A
  // small one empties what no photo shows, and gives way to photos that show something there.
  void draw_masked(Real share) { masked_share_ = share; }
  // A pixel drawn uniformly over all training photos (in panoramas over the sphere); false where it
  // is masked out or the lens has no ray for it (the draw then counts as nothing).
  bool draw(Random& random, Pixel& out) const;
  // A pixel of the i-th training photo, from the middle `share` of its width and height.
  bool draw_from(size_t i, Random& random, double share, Pixel& out) const;
  size_t photos() const { return views_.size(); }
  // Photos of different files: Ray::photo is one of them, the same at every scale.
  const std::vector<std::string>& files() const { return file_names_; }
  int file_of(size_t i) const { return files_[i]; }
  Real time_of(size_t i) const { return times_[i]; }  // Ray::time
  // Of the i-th training photo: camera-to-engine, and the camera at the photo's size, its motion in
  // engine units. They begin as the scene's, without motion.
  const Pose& pose_of(size_t i) const { return poses_[i]; }
  const Camera& camera_of(size_t i) const { return cameras_[i]; }
  void place(size_t i, const Pose& pose, const Camera& camera) {
    poses_[i] = pose;
    cameras_[i] = camera;
  }
  bool has_depth() const { return has_depth_; }        // some photo has a depth map
  double mean_weight() const { return mean_weight_; }  // over all pixels
  // draw() in two halves, so that a caller with many pixels hides the memory's latency: the first
  // finds photo and place and asks for the bytes, the second reads colour, mask and depth.
  bool locate(Random& random, Pixel& out) const;
  bool read(Pixel& out) const;

 private:
  // By chance, as often as the shares say; no number is drawn where a share is 0.
  bool wants_point(Random& random) const;
  bool wants_masked(Random& random, const Photo& photo) const;
  void choose(Random& random, Pixel& out) const;
  bool cast(Pixel& out) const;
  bool read_colour(Pixel& out) const;

  const PhotoSet& photos_;
  const std::vector<int>& views_;        // Scene::train
  std::vector<uint64_t> pixels_before_;  // prefix sums over views_, one more entry than views
  std::vector<Pose> poses_;              // engine coordinates
  std::vector<Camera> cameras_;
  std::vector<Real> weights_;  // of each photo's pixels
  std::vector<int> files_;     // see Ray::photo
  std::vector<std::string> file_names_;
  double mean_weight_ = 1;
  bool has_depth_ = false;
  std::vector<Sighting> sightings_;
  std::vector<std::vector<size_t>> sightings_of_photo_;  // of the i-th training photo
  Real sighting_share_ = 0;
  Real masked_share_ = 0;     // see draw_masked()
  std::vector<double> near_;  // engine units; no sample closer to the camera
  std::vector<Real> times_;   // see Ray::time
};

// Where a step's samples lie on which ray, for what moves the rays.
struct RayLines {
  AlignedArray<Real> distance;  // from the camera, engine units; [chunk][kChunkSamples]
  std::vector<int32_t> ray;     // of the chunk, once the samples that learn are known; likewise
  std::vector<int32_t> source;  // PixelSource::Pixel::source, or -1; [chunk][kChunkRays]
  std::vector<double> share;    // line_share() of the ray's pixel; likewise
};

// Samples of one step. Chunk c owns columns [c * kChunkSamples, ...) and rays [c * kChunkRays,
// ...).
struct RayBatch {
  explicit RayBatch(int max_chunks);
  // Of a sample's arrays, and those of a ray: there may be as many rays.
  static constexpr uint64_t kBytesOfSample = (8 + 18) * sizeof(Real);

  int max_chunks;
  int chunks = 0;
  // Of samples, [chunk][kChunkSamples]: grid coordinates, [0, 1], and the interval's length.
  AlignedArray<Real> x, y, z, delta;
  // Of the samples' intervals in inverse distance, 1 - 1 / (1 + engine units from the camera):
  // [0, 1]. Only where the losses ask for them.
  AlignedArray<Real> middle, width;
  AlignedArray<int32_t> cell;  // occupancy cell: cascade * cells() + cell
  AlignedArray<Real> cell_width;
  std::vector<int> samples, rays;                    // of each chunk
  std::vector<int32_t> ray_begin;                    // of each chunk, kChunkRays + 1 entries
  AlignedArray<Real> direction, background, target;  // [chunk][3][kChunkRays]
  std::vector<Real> weight;                          // of the error, [chunk][kChunkRays]
  std::vector<int32_t> tile;                         // of RobustMask, as `weight`; below 0: none
  std::vector<int32_t> photo;                        // Ray::photo, as `weight`
  std::vector<Real> corner;  // corner_square(), as `weight`; of rays without a pixel 0
  std::vector<Real> time;    // Ray::time, as `weight`
  std::vector<Real> cover;   // 1 where a ray ends in a sky that is learnt, else 0; as `weight`
  // Between which a ray may meet matter (Skylines::matter()), in `middle`'s terms; as `weight`.
  std::vector<Real> matter_begin, matter_end;
  std::vector<Real> depth;  // where light should end, in `middle`'s terms; 0: unknown; as `weight`

  int64_t rays_considered = 0;  // of the step, those that met no matter included
  int64_t rays_masked = 0;      // of these; their Ray::photo is below 0
  int64_t total_samples = 0;
  // Of those that met none and are not masked, summed over rays and channels.
  double empty_squared_error = 0;

  // Of an open step: every ray considered, with its target and its place in the chunks
  // [chunk][kChunkRays], or -1 where it met no matter.
  struct Listed {
    Ray ray;
    Real target[3], weight;
    int32_t place;
  };
  bool lists = false;               // whether fill() lists them
  std::unique_ptr<RayLines> lines;  // only where the caller asks for them
  void keep_lines();
  std::vector<Listed> listed;

  // Moves the grid coordinates of `count` samples of a chunk, `kept` in ascending order, to its
  // front; nothing else of them.
  void keep_points(int chunk, const int32_t* kept, int64_t count);

  Real* direction_of(int chunk) { return direction.data() + int64_t{chunk} * 3 * kChunkRays; }
  Real* background_of(int chunk) { return background.data() + int64_t{chunk} * 3 * kChunkRays; }
  Real* target_of(int chunk) { return target.data() + int64_t{chunk} * 3 * kChunkRays; }
};

// Draws `rays` rays of the step and fills the batch until it is full.
class RayBatchMaker {
 public:
  // `intervals`: fills RayBatch::middle and width too.
  RayBatchMaker(const PixelSource& source, const GridField& field, bool intervals,
                ThreadPool& pool);
  // From now on rays say which tile of it they are of; must outlive this.
  void use_tiles(const RobustMask& robust) { robust_ = &robust; }
  // From now on rays say where they may meet matter; must outlive this.
  void use_skylines(const Skylines& skylines) { skylines_ = &skylines; }
  // What all rays end in, given ones too, in place of what is drawn.
  void set_background(const Vec3& background) { background_ = background; }
  // Of a sample: once more what its block holds, with a vector's reserve, and its ray's record.
  static constexpr uint64_t kBytesOfSample = 2 * 6 * sizeof(Real) + 100;
  void fill(uint64_t seed, int64_t step, int64_t rays, Real samples_per_cell, RayBatch& batch) {
    fill(seed, step, rays, samples_per_cell, {}, batch);
  }
  // The same of `given` rays where there are any: with their own background, and no target.
  void fill(uint64_t seed, int64_t step, int64_t rays, Real samples_per_cell,
            std::span<const Ray> given, RayBatch& batch);

 private:
  struct RayRecord {
    int block_begin = 0, count = 0;  // samples in the block's arrays
    bool valid = false;
    Real direction[3], background[3], target[3];
    Real squared_error = 0;  // against the background alone
    Real weight = 1;
    Real depth = 0, time = 0, corner = 0, cover = 0;
    Real matter_begin = 0, matter_end = 1;
    double share = 0;
    int32_t photo = -1, source = -1, tile = -1;
    int chunk = -1, ray = 0, offset = 0;
    Ray line;  // of an open step
  };
  static constexpr int kBlock = 64;  // rays that are drawn together
  struct Block {
    std::vector<Real> x, y, z, delta, middle, width, cell_width, distance;
    std::vector<int32_t> cell;
    RayRecord rays[kBlock];
  };
  void draw_block(uint64_t seed, int64_t step, int64_t index, int64_t rays,
                  std::span<const Ray> given, int thread);
  // Appends a ray's samples, at entry + t direction, to the block. `start` is the distance of the
  // entry from the camera.
  void place_samples(const Vec3& entry, const Vec3& direction, Real start,
                     const RaySamples& samples, Block& block);
  void copy_block(Block& block, RayBatch& batch);
  static RayBatch::Listed listed_of(const RayRecord& record);

  const PixelSource& source_;
  const GridField& field_;
  bool intervals_, lists_ = false, lines_ = false;
  const RobustMask* robust_ = nullptr;
  const Skylines* skylines_ = nullptr;
  std::optional<Vec3> background_;
  ThreadPool& pool_;
  std::vector<RaySampler> samplers_;  // one per thread
  std::vector<RaySamples> scratch_;
  std::vector<std::vector<Random>> randoms_;  // of a block's rays
  std::vector<Block> blocks_;
};

}  // namespace nerf
