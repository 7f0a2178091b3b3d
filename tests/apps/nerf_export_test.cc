// nerf_export as a process, and its files in nerf_render's pictures.
#include <gtest/gtest.h>

#include <cstdlib>
#include <sstream>

#include "nerf/geometry/object.h"
#include "nerf/io/image.h"
#include "nerf/io/object_file.h"
#include "nerf_train_fixture.h"

namespace nerf {
namespace {

namespace fs = std::filesystem;
using testing_apps::expect_refused;
using testing_apps::ProgramResult;
using testing_apps::read_text;

ProgramResult export_program(const std::vector<std::string>& arguments) {
  return testing_apps::run_program(NERF_EXPORT_PROGRAM, arguments);
}

// A small trained model.
class NerfExport : public testing_apps::NerfTrain {
 protected:
  static void SetUpTestSuite() {
    NerfTrain::SetUpTestSuite();
    runs = new testing_apps::TempFolder;
    const auto arguments = testing_apps::tiny({scene(), "-o", run(), "--steps", "150"});
    ASSERT_EQ(train(arguments).exit_code, 0);
  }
  static void TearDownTestSuite() {
    delete runs;
    NerfTrain::TearDownTestSuite();
  }
  static std::string run() { return (runs->path() / "run").string(); }
  std::string out(const std::string& name) const { return (folder_.path() / name).string(); }
  static inline testing_apps::TempFolder* runs = nullptr;
};

TEST_F(NerfExport, WritesAMeshThatCanBeInserted) {
  const std::string glb = out("mesh.glb"), ply = out("mesh.ply");
  for (const std::string from : {"depth", "density"}) {
    std::vector<std::string> arguments{"mesh",   run(), "-o",          glb,   "--resolution", "48",
                                       "--from", from,  "--triangles", "600", "--threads",    "2"};
    // So few steps leave a fog, of which no voxel is half opaque.
    if (from == "density") arguments.insert(arguments.end(), {"--density", "3"});
    const auto result = export_program(arguments);
    ASSERT_EQ(result.exit_code, 0) << result.err;
    const ReadObject read = read_object(glb);
    EXPECT_GT(read.object.mesh.triangles.size(), 100u);
    EXPECT_LE(read.object.mesh.triangles.size(), 600u);
    EXPECT_EQ(read.object.colours.size(), read.object.mesh.positions.size());
  }
  const auto result = export_program(
      {"mesh", run(), "-o", ply, "--resolution", "32", "--bbox", "-1,-1,-1,1,1,1", "--no-colours"});
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_EQ(read_text(ply).find("red"), std::string::npos);
  EXPECT_NE(read_text(ply).find("element face"), std::string::npos);
  // Moved away from the scene it is seen beside it.
  const auto render = [&](const std::string& folder, std::vector<std::string> more) {
    std::vector<std::string> arguments{run(), "-o", out(folder), "--no-depth"};
    arguments.insert(arguments.end(), more.begin(), more.end());
    const auto drawn = testing_apps::run_program(NERF_RENDER_PROGRAM, arguments);
    EXPECT_EQ(drawn.exit_code, 0) << drawn.err;
    for (const auto& entry : fs::recursive_directory_iterator(out(folder)))
      if (entry.path().extension() == ".png") return read_image_8bit(entry.path()).pixels;
    ADD_FAILURE() << "no picture";
    return std::vector<uint8_t>();
  };
  const auto plain = render("plain", {});
  EXPECT_NE(render("with", {"--insert", glb, "--at", "0.2,0,0.3"}), plain);
  EXPECT_EQ(render("far", {"--insert", glb, "--at", "1000,0,0"}), plain);
}

// Two readers that share no code with ours: assimp checks what it has read, and gltfpack whether
// accessors, views, indices and chunks of a GLB fit each other.
TEST_F(NerfExport, OtherReadersTakeItsMeshes) {
  for (const std::string name : {"mesh.glb", "mesh.ply"}) {
    SCOPED_TRACE(name);
    const auto written = export_program(
        {"mesh", run(), "-o", out(name), "--resolution", "48", "--triangles", "600"});
    ASSERT_EQ(written.exit_code, 0) << written.err;
    std::istringstream counts(written.lines().back());  // "598 triangles, 373 vertices: FILE"
    std::string triangles, vertices, word;
    counts >> triangles >> word >> vertices;
    EXPECT_GT(std::atoi(triangles.c_str()), 100);
    const auto read = testing_apps::run_program("/usr/bin/env", {"assimp", "info", out(name)});
    const std::string said = read.out + read.err;
    EXPECT_EQ(read.exit_code, 0) << said << "\nscripts/install-deps installs assimp-utils";
    for (const std::string& line :
         {"Vertices:           " + vertices + "\n", "Faces:              " + triangles + "\n",
          std::string("Primitive Types:    triangles\n")})
      EXPECT_NE(said.find(line), std::string::npos) << line << said;
    for (const char* complaint : {"warn", "Warn", "WARN", "error", "Error", "ERROR"})
      EXPECT_EQ(said.find(complaint), std::string::npos) << said;
    if (name == "mesh.ply") continue;
    const auto packed = testing_apps::run_program(
        "/usr/bin/env", {"gltfpack", "-v", "-noq", "-i", out(name), "-o", out("packed.glb")});
    EXPECT_EQ(packed.exit_code, 0) << packed.err << "\nscripts/install-deps installs gltfpack";
    EXPECT_NE(packed.out.find("1 mesh primitives (" + triangles + " triangles, " + vertices +
                              " vertices)"),
              std::string::npos)
        << packed.out;
    EXPECT_EQ(packed.err, "");
  }
}

TEST_F(NerfExport, WritesTheSameBytesForAnyThreads) {
  for (const char* threads : {"1", "2"}) {
    const auto result = export_program({"mesh", run(), "-o", out(std::string(threads) + ".ply"),
                                        "--resolution", "40", "--threads", threads});
    ASSERT_EQ(result.exit_code, 0) << result.err;
  }
  EXPECT_EQ(read_text(out("1.ply")), read_text(out("2.ply")));
}

TEST_F(NerfExport, WritesPointsAndCameras) {
  auto result = export_program({"points", run(), "-o", out("p.ply"), "--points", "2000"});
  ASSERT_EQ(result.exit_code, 0) << result.err;
  const std::string text = read_text(out("p.ply"));
  EXPECT_NE(text.find("property float nx"), std::string::npos);
  EXPECT_EQ(text.find("element face"), std::string::npos);
  result = export_program(
      {"cameras", run(), "-o", out("c.glb"), "--path", "orbit", "--frames", "5", "--metres", "2"});
  ASSERT_EQ(result.exit_code, 0) << result.err;
  EXPECT_NE(read_text(out("c.glb")).find("\"animations\""), std::string::npos);
}

TEST_F(NerfExport, ADiskThatIsFullLeavesNoFile) {
  // No file may grow over 1 KB, as if the disk had no more room.
  for (const std::vector<std::string>& arguments :
       {std::vector<std::string>{"mesh", run(), "-o", out("new/a.glb"), "--resolution", "40"},
        {"mesh", run(), "-o", out("new/a.ply"), "--resolution", "40"},
        {"points", run(), "-o", out("new/p.ply"), "--points", "2000"},
        {"cameras", run(), "-o", out("new/c.glb"), "--path", "orbit"}}) {
    SCOPED_TRACE(arguments[3]);
    std::vector<std::string> limited{"-c", "trap '' XFSZ; ulimit -f 1; exec \"$@\"", "bash",
                                     NERF_EXPORT_PROGRAM};
    limited.insert(limited.end(), arguments.begin(), arguments.end());
    const ProgramResult result = testing_apps::run_program("/bin/bash", limited);
    EXPECT_EQ(result.exit_code, 2) << result.err;
    EXPECT_EQ(result.lines().back().rfind("nerf_export: " + arguments[3] + ": cannot write", 0), 0u)
        << result.err;
    EXPECT_FALSE(fs::exists(folder_.path() / "new"));
  }
}

TEST_F(NerfExport, NamesMistakes) {
  const auto refused = [&](const std::vector<std::string>& arguments,
                           const std::vector<std::string>& parts) {
    SCOPED_TRACE(testing::PrintToString(arguments));
    expect_refused(export_program(arguments), "nerf_export", parts);
  };
  refused({"mash", run()}, {"unknown command 'mash'", "mesh"});
  refused({"mesh", run(), "-o", out("a.obj")}, {".glb or .ply"});
  refused({"mesh", run(), "-o", out("a.glb"), "--density", "3"}, {"--from density"});
  // Found at the end, after lines that say what was done.
  for (const std::string command : {"mesh", "points"}) {
    const auto result = export_program({command, run(), "-o", out("new/er/a.ply"),
                                        command == "mesh" ? "--resolution" : "--points", "500",
                                        "--bbox", "8,8,8,9,9,9"});
    EXPECT_EQ(result.exit_code, 2) << result.err;
    EXPECT_EQ(result.lines().back(),
              "nerf_export: --bbox: there is no surface in this box (give another box)");
    EXPECT_FALSE(fs::exists(folder_.path() / "new"));
  }
  refused({"cameras", out("none"), "-o", out("a.glb")}, {"no such file"});
  EXPECT_EQ(folder_.files(), 0);
  for (const char* command : {"mesh", "points", "cameras"})
    EXPECT_EQ(export_program({command, "--help"}).exit_code, 0);
  EXPECT_EQ(export_program({}).exit_code, 0);
}

}  // namespace
}  // namespace nerf
