// Lines of progress.
#include "io/cameras/stage_progress.h"

#include <gtest/gtest.h>

#include <vector>

#include "io/cameras/colmap_program.h"

namespace nerf::internal {
namespace {

TEST(StageProgress, TellsTheFirstAndTheLast) {
  std::vector<std::string> lines;
  const Tell tell = [&](const std::string& line) { lines.push_back(line); };
  StageProgress progress(tell, "matched", "pairs", 100, 20);
  for (int64_t done = 30; done <= 100; done += 10) progress.update(done);
  progress.update(100);
  EXPECT_EQ(lines,
            (std::vector<std::string>{"matched 30 of 100 pairs", "matched 100 of 100 pairs"}));
  StageProgress(Tell(), "nobody", "listens", 3).update(1);
}

TEST(ColmapProgram, WordsOfItsLines) {
  EXPECT_EQ(between("Registering image #7 (12)", "(", ")"), "12");
  EXPECT_EQ(between("nothing", "(", ")"), "");
  EXPECT_EQ(between("open (end", "(", ")"), "end");
  EXPECT_EQ(leading_number("12/50"), 12);
  EXPECT_EQ(leading_number("x"), 0);
}

}  // namespace
}  // namespace nerf::internal
