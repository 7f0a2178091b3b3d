// The commands of docs/tutorials, run one after the other on data/demo.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <sstream>
#include <string>
#include <vector>

#include "run_program.h"

namespace nerf {
namespace {

namespace fs = std::filesystem;
using testing_apps::read_text;

// What stands in blocks that begin with ```sh, lines that end in a backslash joined to the next.
std::vector<std::string> commands_of(const fs::path& document) {
  std::istringstream lines(read_text(document));
  std::vector<std::string> commands;
  bool inside = false, open = false;
  for (std::string line; std::getline(lines, line);) {
    if (line.starts_with("```")) {
      inside = line == "```sh";
      continue;
    }
    if (!inside || line.empty()) continue;
    if (!open) commands.emplace_back();
    open = line.ends_with('\\');
    if (open) line.pop_back();
    commands.back() += line;
  }
  return commands;
}

void replace(std::string& text, const std::string& from, const std::string& to) {
  for (size_t at = text.find(from); at != std::string::npos; at = text.find(from, at + to.size()))
    text.replace(at, from.size(), to);
}

// Runs a tutorial's commands in a folder that looks like the repository, on smaller pictures.
void run_tutorial(const std::string& name, const testing_apps::TempFolder& folder,
                  const std::string& steps) {
  const fs::path root = NERF_SOURCE_DIR;
  fs::create_directories(folder / "build");
  for (const char* name : {"data", "scripts"})
    fs::create_directory_symlink(root / name, folder / name);
  fs::create_directory_symlink(fs::path(NERF_RENDER_PROGRAM).parent_path(),
                               folder / "build/release");
  const auto commands = commands_of(root / "docs/tutorials" / name);
  EXPECT_GT(commands.size(), 4u);
  for (std::string command : commands) {
    replace(command, "--minutes 2",
            "--steps " + steps +
                " --downscale 8 --grid-log2-entries 14 --batch-samples 8192 --overwrite");
    replace(command, "--resolution 1024", "--resolution 64");
    replace(command, "mesh runs/demo -o runs/demo/demo.glb",
            "mesh runs/demo -o runs/demo/demo.glb --resolution 64");
    replace(command, "--triangles 20000", "--triangles 20000 --resolution 64");
    replace(command, "--points 200000", "--points 2000");
    replace(command, "--frames 48", "--frames 2");
    replace(command, "--size 960x540", "--size 48x28");
    // So few frames that colmap places them in seconds.
    replace(command, "-pix_fmt", "-frames:v 14 -vf scale=400:300 -pix_fmt");
    const auto result = testing_apps::run_program(
        "/bin/sh", {"-c", "cd \"$0\" && " + command, folder.path().string()});
    EXPECT_EQ(result.exit_code, 0) << command << "\n" << result.out << result.err;
  }
}

TEST(Tutorials, DepthIntoACompositor) {
  const testing_apps::TempFolder folder;
  run_tutorial("depth_into_a_compositor.md", folder, "20");
  for (const char* file :
       {"comp/exr/orbit_0001.exr", "comp/deep/orbit_0001.exr", "comp/fog.exr", "wipe.mp4",
        "numbers/npy/depth.distance/orbit_0000.npy", "numbers/png16/depth.distance/orbit_0000.png",
        "numbers/layers.json", "wipe/film/orbit_0001.png"})
    EXPECT_TRUE(fs::exists(folder / "runs/demo" / file)) << file;
}

TEST(Tutorials, MeshIntoBlender) {
  const testing_apps::TempFolder folder;
  run_tutorial("mesh_into_blender.md", folder, "250");
  for (const char* file : {"demo.glb", "cameras.glb", "flight/cameras_0001.png",
                           "slow/cameras_0000.png", "fine.ply", "points.ply"})
    EXPECT_TRUE(fs::exists(folder / "runs/demo" / file)) << file;
}

TEST(Tutorials, ObjectIntoAScene) {
  const testing_apps::TempFolder folder;
  run_tutorial("object_into_a_scene.md", folder, "250");
  for (const char* file :
       {"with/orbit_0001.png", "at/orbit_0001.png", "sun/orbit_0001.png", "bounce/orbit_0001.png",
        "moving/orbit_0001.png", "layers/exr/orbit_0001.exr"})
    EXPECT_TRUE(fs::exists(folder / "runs/demo" / file)) << file;
}

TEST(Tutorials, VideoToFilm) {
  const testing_apps::TempFolder folder;
  run_tutorial("video_to_film.md", folder, "20");
  for (const char* file : {"orbit.mp4", "along.mp4", "orbit/orbit_0001.png",
                           "along/film/interpolate_0001.png", "report.html"})
    EXPECT_TRUE(fs::exists(folder / "runs/walk" / file)) << file;
}

}  // namespace
}  // namespace nerf
