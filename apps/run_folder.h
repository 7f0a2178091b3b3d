// What nerf_train writes, and where.
#pragma once

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "nerf/model/medium.h"
#include "nerf/train/evaluation.h"
#include "nerf/train/light_report.h"
#include "nerf/train/run.h"

namespace nerf::apps {

inline constexpr const char* kCaptureFolder = "capture";

// The folder of a run. Created by the constructor where it is missing; one that was created for
// nothing is removed again by the destructor, unless keep() was called.
class RunFolder {
 public:
  // Throws Error where it cannot be written into, and where it holds a run that neither `resume`
  // nor `overwrite` allows to touch, or nothing to resume.
  RunFolder(std::filesystem::path path, bool resume, bool overwrite);
  ~RunFolder();
  RunFolder(const RunFolder&) = delete;
  RunFolder& operator=(const RunFolder&) = delete;
  void keep() { keep_ = true; }

  const std::filesystem::path& path() const { return path_; }
  std::filesystem::path options() const { return path_ / "options.json"; }
  std::filesystem::path metrics() const { return path_ / "metrics.jsonl"; }
  std::filesystem::path result() const { return path_ / "result.json"; }
  std::filesystem::path model() const { return path_ / "model.nerf"; }
  std::filesystem::path checkpoint() const { return path_ / "checkpoint.nerf"; }
  std::filesystem::path pictures() const { return path_ / "eval"; }
  std::filesystem::path notes() const { return path_ / "notes.json"; }
  std::filesystem::path report() const { return path_ / "report.html"; }
  std::filesystem::path refined() const { return path_ / "refined"; }  // cameras
  // Where the cameras of photos and the frames of a video are worked out.
  std::filesystem::path capture() const { return path_ / kCaptureFolder; }

  bool has_checkpoint() const;
  // Before a finished run is extended: it has no result until it is done again.
  void begin_again() const;
  // Removes what an earlier run left (where there was one), nothing else.
  void clear() const;

 private:
  std::filesystem::path path_;
  std::vector<std::filesystem::path> created_;  // outermost first
  bool keep_ = false;
};

// metrics.jsonl: a line per reported step and per evaluation, each whole or not there.
class MetricsFile {
 public:
  // Goes on behind the lines of steps up to `steps`; later ones, of a run that was killed after its
  // last checkpoint, are dropped.
  MetricsFile(std::filesystem::path path, int64_t steps);
  void add_step(const RunProgress& progress);
  void add_evaluation(int64_t step, double train_seconds, const Evaluation& evaluation);

 private:
  void append(const std::string& line);
  std::filesystem::path path_;
};

struct RunSummary {
  std::string scene;
  uint64_t seed = 0;
  int threads = 0;
  std::string precision;
  double decode_seconds = 0;
  RunResult run;
  Evaluation evaluation;
  TrainProfile profile;          // of the steps of this process
  std::vector<double> readouts;  // Trainer::readouts()
  LightReport light;
  std::optional<Medium> medium;  // that was learnt
};

// The model's cameras, at the size of the scene's photos: cameras.txt, images.txt, points3D.txt
// and, where it can say them, transforms.json, whose paths are those from the capture's folder.
void write_cameras(const std::filesystem::path& folder, const ModelInfo& info, const Scene& scene);

void write_result(const std::filesystem::path& path, const RunSummary& summary);

}  // namespace nerf::apps
