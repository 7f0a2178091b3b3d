#include "io/cameras/match_stage.h"

#include <fmt/format.h>

#include <algorithm>
#include <map>
#include <tuple>

#include "io/cameras/descriptor_matches.h"
#include "io/cameras/feature_database.h"
#include "io/cameras/global_descriptor.h"
#include "nerf/base/error.h"

namespace nerf::internal {

namespace fs = std::filesystem;

namespace {

constexpr int kBlock = 64;           // photos; the descriptors of two blocks are in memory
constexpr size_t kPairsAtOnce = 64;  // between two looks at the clock and the request to stop
constexpr size_t kSampled = 40000;   // features, for the words of the global descriptor

void check(const Cancel* cancel) {
  if (cancel && cancel->requested()) throw Cancelled();
}

// Photos in the order of their names, with those that have no features.
struct Features {
  FeatureDatabase database;
  std::vector<int64_t> ids;  // -1 where colmap could not read the photo

  Features(const CapturePhotos& photos, const fs::path& file) : database(file) {
    std::map<std::string, int64_t> id_of;
    for (const FeatureDatabase::Image& image : database.images()) id_of[image.name] = image.id;
    for (const CapturePhoto& photo : photos.photos) {
      const auto it = id_of.find(photo.name);
      ids.push_back(it == id_of.end() ? -1 : it->second);
    }
  }
  std::vector<uint8_t> descriptors(int photo) {
    const int64_t id = ids[static_cast<size_t>(photo)];
    return id < 0 ? std::vector<uint8_t>() : database.descriptors(id);
  }
};

std::vector<std::vector<float>> global_descriptors(Features& features, ThreadPool& pool,
                                                   const Cancel* cancel) {
  const size_t count = features.ids.size();
  int64_t all = 0;
  for (const int64_t id : features.ids)
    if (id >= 0) all += features.database.feature_count(id);
  const size_t step = static_cast<size_t>(all) / kSampled + 1;
  std::vector<uint8_t> sample;
  for (size_t i = 0; i < count; ++i) {
    check(cancel);
    const std::vector<uint8_t> d = features.descriptors(static_cast<int>(i));
    for (size_t f = i % step; f < d.size() / kDescriptorBytes; f += step) {
      const auto from = d.begin() + static_cast<std::ptrdiff_t>(f * kDescriptorBytes);
      sample.insert(sample.end(), from, from + kDescriptorBytes);
    }
  }
  const GlobalDescriptor global(sample);
  std::vector<std::vector<float>> out(count);
  for (size_t begin = 0; begin < count; begin += kBlock) {
    check(cancel);
    std::vector<std::vector<uint8_t>> block;
    for (size_t i = begin; i < std::min(count, begin + kBlock); ++i)
      block.push_back(features.descriptors(static_cast<int>(i)));
    pool.parallel_for(static_cast<int64_t>(block.size()), [&](int64_t i) {
      out[begin + static_cast<size_t>(i)] = global.of(block[static_cast<size_t>(i)]);
    });
  }
  return out;
}

std::vector<PhotoPair> pairs_to_match(const CapturePhotos& photos, Features& features,
                                      const PairSettings& settings, ThreadPool& pool,
                                      const Tell& tell, const Cancel* cancel) {
  const int count = static_cast<int>(photos.photos.size());
  if (count <= settings.every_pair_up_to) return every_pair(count);
  std::vector<std::optional<std::array<double, 2>>> places;
  for (const CapturePhoto& photo : photos.photos) places.push_back(photo.tags.place);
  std::vector<PhotoPair> pairs =
      likely_pairs(global_descriptors(features, pool, cancel), places, settings);
  if (tell) {
    tell(fmt::format("{} of {} pairs of photos may show the same things", pairs.size(),
                     static_cast<int64_t>(count) * (count - 1) / 2));
  }
  return pairs;
}

}  // namespace

void match_features(const CapturePhotos& photos, const fs::path& file, const PairSettings& settings,
                    ThreadPool& pool, const Tell& tell, const Cancel* cancel) {
  Features features(photos, file);
  std::vector<PhotoPair> pairs = pairs_to_match(photos, features, settings, pool, tell, cancel);
  // The database's pairs have the lower id first, whatever the order of names.
  const auto id_pair = [&](const PhotoPair& pair) {
    const int64_t a = features.ids[static_cast<size_t>(pair.first)],
                  b = features.ids[static_cast<size_t>(pair.second)];
    return ImageIdPair(std::min(a, b), std::max(a, b));
  };
  const auto total = static_cast<int64_t>(pairs.size());
  const std::vector<ImageIdPair> known = features.database.matched_pairs();
  std::erase_if(pairs, [&](const PhotoPair& pair) {
    const ImageIdPair ids = id_pair(pair);
    return ids.first < 0 || std::ranges::binary_search(known, ids);
  });
  // Block by block, so that few photos' descriptors are needed at a time.
  std::ranges::sort(pairs, {}, [](const PhotoPair& p) {
    return std::tuple(p.first / kBlock, p.second / kBlock, p.first, p.second);
  });
  int64_t done = total - static_cast<int64_t>(pairs.size());
  StageProgress progress(tell, "matched", "pairs of photos", total, done);
  std::map<int, std::vector<uint8_t>> descriptors;
  PhotoPair block{-1, -1};
  for (size_t begin = 0; begin < pairs.size();) {
    check(cancel);
    const PhotoPair now{pairs[begin].first / kBlock, pairs[begin].second / kBlock};
    if (now != block) {
      block = now;
      std::erase_if(descriptors, [&](const auto& entry) {
        return entry.first / kBlock != block.first && entry.first / kBlock != block.second;
      });
    }
    size_t end = begin;
    for (; end < pairs.size() && end < begin + kPairsAtOnce; ++end) {
      const PhotoPair& p = pairs[end];
      if (PhotoPair(p.first / kBlock, p.second / kBlock) != block) break;
      for (const int photo : {p.first, p.second})
        if (!descriptors.contains(photo)) descriptors[photo] = features.descriptors(photo);
    }
    std::vector<std::vector<FeatureMatch>> matches(end - begin);
    pool.parallel_for(static_cast<int64_t>(matches.size()), [&](int64_t i) {
      auto [a, b] = pairs[begin + static_cast<size_t>(i)];
      if (features.ids[static_cast<size_t>(a)] > features.ids[static_cast<size_t>(b)])
        std::swap(a, b);
      matches[static_cast<size_t>(i)] = match_descriptors(descriptors.at(a), descriptors.at(b));
    });
    features.database.begin();
    for (size_t i = 0; i < matches.size(); ++i) {
      const bool enough = static_cast<int64_t>(matches[i].size()) >= kFewestMatches;
      features.database.write_matches(id_pair(pairs[begin + i]),
                                      enough ? matches[i] : std::vector<FeatureMatch>());
    }
    features.database.commit();
    done += static_cast<int64_t>(matches.size());
    begin = end;
    progress.update(done);
  }
}

void verify_matches(const ColmapProgram& colmap, const fs::path& file, const Tell& tell) {
  int64_t count = 0;
  {
    FeatureDatabase database(file);
    count = static_cast<int64_t>(database.images().size());
    // A pair whose matches are in the database is not matched again but verified; none, of a pair
    // that was not chosen, are quick to verify. (A list of the chosen pairs for matches_importer
    // cannot hold names with spaces.)
    database.fill_with_no_matches();
  }
  const int64_t block = std::clamp<int64_t>(count / 10, 10, 50);  // for progress in between
  const int64_t blocks = (count + block - 1) / block;
  StageProgress progress(tell, "colmap: verified matches,", "blocks of pairs", blocks * blocks);
  colmap.run("exhaustive_matcher", {"--database_path", file.string()},
             {{"use_gpu", "0"},
              {"num_threads", std::to_string(available_processors())},
              {"block_size", std::to_string(block)}},
             [&](std::string_view line) {
               // "Matching block [2/6, 1/6]"
               const std::string_view at = between(line, "block [", "]");
               const std::string_view column = between(at, ", ", "/");
               if (column.empty()) return;
               progress.update((leading_number(at) - 1) * blocks + leading_number(column));
             });
}

}  // namespace nerf::internal
