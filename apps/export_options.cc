#include "export_options.h"

#include "nerf/base/error.h"

namespace nerf::apps {

namespace {

void check_extension(const std::filesystem::path& out, std::initializer_list<const char*> allowed) {
  std::string names;
  for (const char* extension : allowed) {
    if (out.extension() == extension) return;
    names += std::string(names.empty() ? "" : " or ") + extension;
  }
  throw Error("'" + out.string() + "' does not end in " + names, "--out");
}

}  // namespace

void MeshCommand::check_options() const {
  check_extension(out, {".glb", ".ply"});
  if (density > 0 && from == SurfaceSource::kDepth)
    throw Error("a density is for --from density", "--density", "leave it out");
}
void PointsCommand::check_options() const { check_extension(out, {".ply"}); }
void CamerasCommand::check_options() const { check_extension(out, {".glb"}); }

}  // namespace nerf::apps
