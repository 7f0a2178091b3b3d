#include "moving_film.h"

#include <fmt/format.h>

#include <algorithm>
#include <vector>

#include "corner_tracks.h"
#include "nerf/io/photos.h"

namespace nerf::internal {

namespace {

constexpr int64_t kFewest = 200;
constexpr double kMoving = 0.06;

// The frames in the order of time, decoded at up to twice the size that corners are followed at.
std::vector<SweepImage> small_frames(const SceneInput& input, ThreadPool& pool) {
  Scene film;
  film.cameras = input.cameras;
  film.views = input.views;
  std::ranges::stable_sort(film.views, {}, &View::time);
  int longest = 0;
  for (const Camera& camera : film.cameras)
    longest = std::max({longest, camera.width, camera.height});
  film.options.downscale = std::max(1, longest / (2 * kTrackedSize));
  const PhotoSet photos = load_photos(film, pool);
  std::vector<SweepImage> frames(photos.photos.size());
  pool.parallel_for(static_cast<int64_t>(frames.size()), [&](int64_t i) {
    const auto v = static_cast<size_t>(i);
    frames[v] =
        make_sweep_image(photos.photos[v], photos.cameras[v], film.views[v].pose, kTrackedSize);
  });
  return frames;
}

}  // namespace

bool film_moves(const SceneInput& input, SceneReport& report,
                const std::function<void(const std::string&)>& progress, const Cancel* cancel) {
  if (progress) progress("looking for what moves in " + input.times->source);
  ThreadPool pool;
  const CornerTracks tracks = follow_corners(small_frames(input, pool), pool, cancel);
  if (tracks.followed < kFewest) return false;
  const double share = static_cast<double>(tracks.moving) / static_cast<double>(tracks.followed);
  const bool moves = share >= kMoving;
  report.notes.push_back(
      fmt::format("{:.0f} % of {} corners that were followed through {} go where nothing does "
                  "that stands still{}",
                  100 * share, tracks.followed, input.times->source,
                  moves ? ": what moves is learnt as moving (--times none: all frames are taken as "
                          "of one moment)"
                        : ""));
  return moves;
}

}  // namespace nerf::internal
