// The paper methods as a user runs them.
#include "nerf/train/methods.h"
#include "nerf_train_fixture.h"

namespace nerf {
namespace {

using namespace testing_apps;

class NerfTrainMethods : public NerfTrain {
 protected:
  Arguments of_method(const std::string& method, Arguments more) const {
    Arguments a = {
        scene(),        "-o", run_folder(),      "--method", method,          "--scale", "tiny",
        "--eval-every", "0",  "--network-width", "16",       "--recipe-rays", "64"};
    a.insert(a.end(), more.begin(), more.end());
    return a;
  }
};

TEST_F(NerfTrainMethods, TrainAndRender) {
  for (const std::string& method : method_names()) {
    if (method == kGridMethod) continue;
    SCOPED_TRACE(method);
    Arguments more = {"--steps", "5", "--overwrite"};
    if (method_options(method, Scale::kTiny).network.deform.any())
      more.insert(more.end(), {"--times", "frame"});  // learns what moves
    const ProgramResult result = train(of_method(method, more));
    ASSERT_EQ(result.exit_code, 0) << result.err;
    const auto json = nlohmann::json::parse(file("result.json"));
    EXPECT_EQ(json["steps"], 5);
    EXPECT_TRUE(json["psnr"].is_number());
    const auto options = nlohmann::json::parse(file("options.json"));
    EXPECT_EQ(options["method"], method);
    EXPECT_EQ(options["network"]["width"], 16);
    const ProgramResult rendered =
        run_program(NERF_RENDER_PROGRAM, {run_folder(), "--views", "test", "--size", "16x16", "-o",
                                          run_folder("pictures"), "--bbox", "-1,-1,-1,1,1,1"});
    EXPECT_EQ(rendered.exit_code, 0) << rendered.err;
    int pictures = 0;  // two views, colour and depth
    for (const auto& entry : fs::recursive_directory_iterator(run_folder("pictures")))
      pictures += entry.path().extension() == ".png";
    EXPECT_EQ(pictures, 4);
  }
}

// A budget's plan, taken again as the command that is printed, gives the same bits.
TEST_F(NerfTrainMethods, ABudgetIsRepeatedByTheCommandThatIsPrinted) {
  const ProgramResult result = train(of_method("mipnerf", {"--minutes", "0.02"}));
  ASSERT_EQ(result.exit_code, 0) << result.err;
  const std::string command = printed_command(result, "the same result again: ");
  EXPECT_NE(command.find("--method mipnerf --"), std::string::npos) << command;
  EXPECT_NE(command.find("--scale tiny"), std::string::npos) << command;
  const ProgramResult again = run_program("/bin/sh", in_shell(command));
  ASSERT_EQ(again.exit_code, 0) << again.err;
  EXPECT_TRUE(model("a run") == model("a run_again"));
}

TEST_F(NerfTrainMethods, ResumeKeepsTheMethod) {
  ASSERT_EQ(train(of_method("nerf", {"--steps", "4"})).exit_code, 0);
  const ProgramResult done = train({"-o", run_folder(), "--resume"});
  EXPECT_EQ(done.exit_code, 0) << done.err;
  expect_refused(train({"-o", run_folder(), "--resume", "--method", "mipnerf"}), "nerf_train",
                 {"--method nerf, not mipnerf"});
}

TEST_F(NerfTrainMethods, TheTableIsPrinted) {
  const ProgramResult result = train({"--list-methods"});
  EXPECT_EQ(result.exit_code, 0);
  EXPECT_EQ(result.out, methods_table());
}

TEST_F(NerfTrainMethods, MistakesAndUnusedOptionsAreNamed) {
  expect_refused(train({scene(), "-o", run_folder(), "--method", "mipnef"}), "nerf_train",
                 {"--method", "mipnerf"});
  expect_refused(train(of_method("nerf", {"--steps", "2", "--network-cast", "cone"})), "nerf_train",
                 {"--network-cast", "cones need intervals"});
  const ProgramResult unused = train(of_method("nerf", {"--steps", "2", "--grid-levels", "4"}));
  EXPECT_EQ(unused.exit_code, 0);
  expect_line(unused, "--grid-levels is not used by --method nerf");
}

}  // namespace
}  // namespace nerf
