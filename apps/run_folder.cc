#include "run_folder.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <nlohmann/json.hpp>
#include <sstream>

#include "light_notes.h"
#include "medium_notes.h"
#include "nerf/base/error.h"
#include "nerf/base/file.h"
#include "nerf/base/memory.h"
#include "nerf/io/camera_files.h"
#include "nerf/kernels/simd.h"
#include "score_text.h"

namespace nerf::apps {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

std::string dump(const Json& json, int indent = -1) {
  return json.dump(indent, ' ', false, Json::error_handler_t::replace) + "\n";
}

Json view_scores(const Evaluation& e) {
  Json views = Json::array();
  const auto number = [](const std::optional<double>& x) { return x ? Json(*x) : Json(); };
  for (const ViewScore& v : e.views) {
    views.push_back(
        {{"name", v.name}, {"scale", v.scale}, {"psnr", number(v.psnr)}, {"ssim", number(v.ssim)}});
    if (!v.picture.empty()) views.back()["picture"] = v.picture;
    if (!v.depth.empty()) views.back()["depth"] = {v.depth.near, v.depth.far};
    if (v.held_out != HeldOut::kStatic) views.back()["held_out"] = held_out_name(v.held_out);
    if (!e.aligned) continue;
    views.back()["aligned_psnr"] = number(v.aligned_psnr);
    views.back()["aligned_ssim"] = number(v.aligned_ssim);
  }
  return views;
}

Json scale_scores(const Evaluation& e) {
  Json scales = Json::array();
  for (const ScaleScore& s : e.scales)
    scales.push_back(
        {{"scale", s.scale}, {"psnr", s.psnr}, {"ssim", s.ssim}, {"views", s.counted}});
  return scales;
}

// Of the kinds of held-out views that a capture in motion has.
Json held_out_scores(const Evaluation& e) {
  Json scores = Json::object();
  for (const HeldOutScore& s : e.held_out)
    scores[held_out_name(s.held_out)] = {{"psnr", s.psnr}, {"ssim", s.ssim}, {"views", s.counted}};
  return scores;
}

Json profile_json(const TrainProfile& p) {
  return {{"rays", p.rays},       {"encode", p.encode}, {"network", p.network},
          {"scatter", p.scatter}, {"update", p.update}, {"occupancy", p.occupancy}};
}

}  // namespace

RunFolder::RunFolder(fs::path path, bool resume, bool overwrite) : path_(std::move(path)) {
  std::error_code ignored;
  const std::string shown = path_.string();
  if (resume && !has_checkpoint() && !fs::exists(options(), ignored))
    throw Error("there is no run to resume in this folder", shown,
                "leave --resume out to begin one, or name the right folder with -o");
  if (!resume && !overwrite &&
      (has_checkpoint() || fs::exists(result(), ignored) || fs::exists(model(), ignored)))
    throw Error("this folder holds a run", shown,
                "--resume goes on with it, --overwrite begins anew, -o names another folder");
  for (fs::path p = fs::absolute(path_).lexically_normal(); !p.empty() && !fs::exists(p, ignored);
       p = p.parent_path())
    if (p.has_filename()) created_.insert(created_.begin(), p);
  make_writable_folder(path_);
}

RunFolder::~RunFolder() {
  if (keep_) return;
  std::error_code ignored;
  fs::remove(capture(), ignored);  // if empty, here and below
  for (auto p = created_.rbegin(); p != created_.rend(); ++p) fs::remove(*p, ignored);
}

bool RunFolder::has_checkpoint() const {
  std::error_code ignored;
  return fs::exists(checkpoint(), ignored);
}

void RunFolder::begin_again() const {
  std::error_code failed;
  for (const fs::path& file : {result(), report()}) {
    fs::remove(file, failed);
    if (failed) throw errno_error(failed.value(), "cannot remove", file);
  }
}

void RunFolder::clear() const {
  std::error_code failed;
  if (!fs::exists(options(), failed) && !has_checkpoint()) return;
  const auto remove = [&](const fs::path& file) {
    fs::remove(file, failed);
    if (failed) throw errno_error(failed.value(), "cannot remove", file);
  };
  for (const fs::path& file : {checkpoint(), model(), result(), metrics(), notes(), report()})
    remove(file);
  std::vector<fs::path> old;
  for (const fs::path& folder : {pictures(), pictures() / kPictureMasks})
    for (const auto& entry : fs::directory_iterator(folder, failed))
      if (entry.path().extension() == ".png") old.push_back(entry.path());
  for (const fs::path& file : old) remove(file);
  remove(options());  // last: an interrupted clearing can be taken up again
}

MetricsFile::MetricsFile(fs::path path, int64_t steps) : path_(std::move(path)) {
  std::error_code ignored;
  std::string kept;
  if (steps > 0 && fs::exists(path_, ignored)) {
    std::istringstream lines(read_text_file(path_));
    for (std::string line; std::getline(lines, line);) {
      const Json json = Json::parse(line, nullptr, /*allow_exceptions=*/false);
      if (json.is_object() && json.contains("step") && json["step"].is_number_integer() &&
          json["step"].get<int64_t>() <= steps)
        kept += line + "\n";
    }
  }
  write_file_atomically(path_, kept);
}

void MetricsFile::append(const std::string& line) {
  const int fd = ::open(path_.c_str(), O_WRONLY | O_APPEND | O_CREAT | O_CLOEXEC, 0666);
  if (fd < 0) throw errno_error(errno, "cannot write", path_);
  const off_t before = ::lseek(fd, 0, SEEK_END);
  const ssize_t n = ::write(fd, line.data(), line.size());
  const int code = n < 0 ? errno : ENOSPC;
  const bool whole = n == static_cast<ssize_t>(line.size());
  if (!whole && n > 0 && ::ftruncate(fd, before) != 0) { /* the next resume drops the half line */
  }
  ::close(fd);
  if (!whole) throw errno_error(code, "cannot write", path_);
}

void MetricsFile::add_step(const RunProgress& p) {
  append(dump(Json{{"kind", "step"},
                   {"step", p.report.step},
                   {"seconds", p.train_seconds},
                   {"loss", p.report.loss},
                   {"psnr", p.psnr},
                   {"rate", p.report.rate},
                   {"opacity", p.report.opacity},
                   {"rays", p.report.rays},
                   {"samples", p.report.samples},
                   {"colours", p.report.colours},
                   {"learning", p.report.learning},
                   {"rows", p.report.rows},
                   {"samples_per_second", p.samples_per_second}}));
}

void MetricsFile::add_evaluation(int64_t step, double train_seconds, const Evaluation& e) {
  append(dump(Json{{"kind", "evaluation"},
                   {"step", step},
                   {"seconds", train_seconds},
                   {"psnr", e.psnr},
                   {"ssim", e.ssim},
                   {"views", e.counted},
                   {"evaluation_seconds", e.seconds},
                   {"scales", scale_scores(e)},
                   {"held_out", held_out_scores(e)},
                   {"per_view", view_scores(e)}}));
}

void write_cameras(const fs::path& folder, const ModelInfo& info, const Scene& scene) {
  std::vector<CameraOfPhoto> photos;
  bool transforms = true;
  for (size_t v = 0; v < info.views.size(); ++v) {
    const ModelView& view = info.views[v];
    const View& photo = scene.views[v];  // those of other sizes stand behind
    const Camera& full = scene.cameras[static_cast<size_t>(photo.camera)];
    const fs::path file = photo.image_path.lexically_relative(scene.root);
    photos.push_back({view.name, (file.empty() ? photo.image_path : file).generic_string(),
                      view.camera.scaled_to(full.width, full.height), view.pose});
    transforms = transforms && transforms_know(view.camera.model);
  }
  write_colmap_text(folder, photos);
  if (transforms) write_transforms(folder / "transforms.json", photos);
}

void write_result(const fs::path& path, const RunSummary& s) {
  const bool measured = s.evaluation.counted > 0;
  const auto aligned = [&](double x) { return s.evaluation.aligned ? Json(x) : Json(); };
  Json result{{"scene", s.scene},
              {"psnr", measured ? Json(s.evaluation.psnr) : Json()},
              {"ssim", measured ? Json(s.evaluation.ssim) : Json()},
              {"aligned_psnr", aligned(s.evaluation.aligned_psnr)},
              {"aligned_ssim", aligned(s.evaluation.aligned_ssim)},
              {"seconds", s.run.train_seconds},
              {"steps", s.run.steps},
              {"samples", s.run.samples},
              {"samples_per_second", s.run.samples_per_second()},
              {"rays", s.run.rays},
              {"peak_memory_bytes", peak_memory_bytes()},
              {"decode_seconds", s.decode_seconds},
              {"evaluation_seconds", s.run.evaluation_seconds},
              {"saving_seconds", s.run.saving_seconds},
              {"profile", profile_json(s.profile)},
              {"failures", s.run.failures},
              {"seed", s.seed},
              {"threads", s.threads},
              {"simd", simd_target()},
              {"precision", s.precision},
              {"light", light_json(s.light)},
              {"scales", scale_scores(s.evaluation)},
              {"held_out", held_out_scores(s.evaluation)},
              {"views", view_scores(s.evaluation)}};
  if (s.medium) result["medium"] = medium_json(*s.medium);
  if (!s.readouts.empty()) result["readouts"] = s.readouts;
  write_file_atomically(path, dump(result, 2));
}

}  // namespace nerf::apps
