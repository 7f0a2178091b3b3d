// What transforms files say besides images, poses and lenses; numbers that are none.
#include <gtest/gtest.h>

#include "io/lenient_json.h"
#include "io/scene_input.h"
#include "test_scenes.h"

namespace nerf::internal {
namespace {

using namespace nerf::test;

class Fields : public ::testing::Test {
 protected:
  // Six frames images/0.png ... with the entries of `head` in the file.
  SceneInput read(const std::string& head, const std::function<void(std::string&)>& change = {}) {
    std::string text = transforms_text(6, "images/", ".png", R"("fl_x":50,"w":40,"h":30)" + head);
    if (change) change(text);
    write_text(folder_ / "transforms.json", text);
    return read_transforms_scene(folder_ / "transforms.json");
  }
  TempFolder folder_;
};

std::vector<std::string> names_of(const SceneInput& input, char test) {
  std::vector<std::string> names;
  for (size_t i = 0; i < input.views.size(); ++i)
    if (input.is_test[i] == test) names.push_back(input.views[i].name);
  return names;
}

using Names = std::vector<std::string>;

TEST_F(Fields, SplitOfTheFile) {
  SceneInput input = read(
      R"(,"train_filenames":["images/0.png","./images/1.png","images\\2"],)"
      R"("val_filenames":["images/3.png"],"test_filenames":["images/3.png","images/4.png","x.png"])");
  EXPECT_EQ(names_of(input, 0), (Names{"images/0.png", "images/1.png", "images/2.png"}));
  EXPECT_EQ(names_of(input, 1), (Names{"images/3.png", "images/4.png"}));
  EXPECT_TRUE(any_contains(input.notes, "2 of 6 photos are held out"));
  EXPECT_TRUE(any_contains(input.warnings, "on neither side: images/5.png"));
  EXPECT_TRUE(any_contains(input.warnings, "\"test_filenames\" lists 1 that is no frame: x.png"));
  EXPECT_TRUE(input.ignored.empty());

  input = read(R"(,"val_filenames":["images/3.png"])");
  EXPECT_EQ(names_of(input, 1), Names{"images/3.png"});
  EXPECT_EQ(input.views.size(), 6u);

  input = read(R"(,"train_filenames":["images/0.png","images/1.png"],)"
               R"("test_filenames":["images/1.png"])");
  EXPECT_EQ(names_of(input, 0), Names{"images/0.png"});
  EXPECT_TRUE(any_contains(input.warnings, "1 photos are listed for training and for measuring"));

  EXPECT_TRUE(read(R"(,"train_filenames":[])").is_test.empty());
  EXPECT_TRUE(read(R"(,"test_filenames":["nothing.png"])").is_test.empty());
  EXPECT_TRUE(contains(error_of([&] { read(R"(,"train_filenames":"all")"); }),
                       "transforms.json: \"train_filenames\" is not a list of names"));
}

TEST_F(Fields, SplitOfTheFileReachesTheScene) {
  for (int i = 0; i < 6; ++i) write_picture(folder_ / "images" / fmt::format("{}.png", i));
  read(R"(,"train_filenames":["images/1.png","images/2.png","images/5.png"],)"
       R"("test_filenames":["images/4.png"])");
  const Scene scene = load_scene(folder_.path());
  ASSERT_EQ(scene.test.size(), 1u);
  EXPECT_EQ(scene.views[static_cast<size_t>(scene.test[0])].name, "images/4.png");
  EXPECT_EQ(scene.train.size(), 3u);
}

TEST_F(Fields, WhatIsNotReadIsNamed) {
  const SceneInput input =
      read(R"(,"aabb_scale":4,"applied_transform":[[1,0,0,0]],"totp":[1,2],"n_frames":6)",
           [](std::string& text) {
             text.insert(text.find("\"file_path\""), R"("colmap_im_id":3,"sharpness":9,)");
           });
  EXPECT_EQ(input.ignored,
            (Names{"\"aabb_scale\" of transforms.json (--bbox sets the box to reconstruct)",
                   "\"applied_transform\" of transforms.json (coordinates are the file's, not the "
                   "reconstruction's)",
                   "\"colmap_im_id\", \"n_frames\", \"sharpness\", \"totp\" of transforms.json"}));
}

TEST_F(Fields, UpIsObeyed) {
  EXPECT_FALSE(read("").up);
  EXPECT_EQ(read(R"(,"orientation_override":"none")").up->z, 1);
  EXPECT_FALSE(read(R"(,"orientation_override":"pca")").up);
  const SceneInput input = read(R"(,"up":[0,-2,0])");
  EXPECT_EQ(input.up->y, -1);
  EXPECT_FALSE(read(R"(,"up":[0,0,0])").up);
  EXPECT_FALSE(read(R"(,"up":[NaN,0,1])").up && read(R"(,"up":[NaN,0,1])").up->x != 0);
}

TEST_F(Fields, FieldsOfViewInDegrees) {
  const SceneInput input =
      read(R"(,"x_fov":90)", [](std::string& text) { text.erase(text.find("\"fl_x\":50,"), 10); });
  EXPECT_NEAR(input.cameras[0].fx(), 20, 1e-9);
}

TEST_F(Fields, NumbersThatAreNoneDoNoHarmWhereNobodyNeedsThem) {
  const SceneInput input =
      read(R"(,"totp":[NaN,-nan(ind),Infinity,-Infinity,nan,inf],"note":"NaN \" NaN")");
  EXPECT_EQ(input.views.size(), 6u);
  EXPECT_EQ(read_lenient_json(folder_ / "transforms.json")["note"], "NaN \" NaN");
  EXPECT_TRUE(is_not_finite(read_lenient_json(folder_ / "transforms.json")["totp"][1]));
  // Still no JSON: words that are no numbers, text that does not end.
  EXPECT_TRUE(contains(error_of([&] { read(R"(,"a":nano)"); }), "parse error at line"));
  EXPECT_TRUE(contains(error_of([&] { read(R"(,"a":NaN,"b":"x)"); }), "transforms.json"));
}

TEST_F(Fields, PhotosWhosePoseOrCameraIsNoneAreLeftOutByName) {
  const auto in_frame = [](const std::string& name, const std::string& entry) {
    return [=](std::string& text) {
      text.insert(text.find("\"file_path\":\"images/" + name), entry + ",");
    };
  };
  SceneInput input = read("", in_frame("2", R"("fl_x":NaN)"));
  EXPECT_EQ(input.views.size(), 5u);
  EXPECT_TRUE(any_contains(input.warnings, "1 of 6 photos are left out"));
  EXPECT_TRUE(any_contains(input.warnings, ": images/2.png"));
  input = read("", [](std::string& text) {
    const size_t row = text.find("[[", text.find("images/4.png"));
    text.replace(row, text.find(',', row) - row, "[[NaN");
  });
  EXPECT_TRUE(any_contains(input.warnings, ": images/4.png"));
  // The file's own, which all need.
  EXPECT_TRUE(contains(error_of([&] { read(R"(,"fl_y":NaN)"); }), "\"fl_y\" is not finite"));
}

TEST_F(Fields, WhereNoFrameIsLeftTheFirstFaultIsSaid) {
  const std::string error = error_of([&] {
    read("", [](std::string& text) {
      for (size_t at = 0; (at = text.find("\"file_path\"", at)) != text.npos; at += 24)
        text.insert(at, "\"cx\":Infinity,");
    });
  });
  EXPECT_TRUE(contains(error, "transforms.json, frames[0]: \"cx\" is not finite"));
}

}  // namespace
}  // namespace nerf::internal
