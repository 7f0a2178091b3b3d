// A run's report in a real browser: no script error, every picture there, and what moves moves.
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "nerf_train_fixture.h"
#include "run_program.h"

namespace nerf {
namespace {

namespace fs = std::filesystem;
using testing_apps::ProgramResult;
using testing_apps::run_program;

// Put behind the page's own script: does what a reader would, and writes down what came of it.
constexpr const char* kReader = R"(<script>
(async function () {
  const result = {};
  // A browser without a window draws no frames one after the other.
  window.requestAnimationFrame = (draw) => setTimeout(draw, 10);
  const wait = () => new Promise((done) => setTimeout(done, 60));
  try {
    const images = [...document.images];
    for (const image of images) image.loading = "eager";
    await Promise.all(images.map((image) => image.complete || new Promise((done) => {
      image.onload = image.onerror = done;
    })));
    result.images = images.length;
    const sheet = new OffscreenCanvas(8, 8).getContext("2d", { willReadFrequently: true });
    result.empty = images.filter((image) => {
      if (!(image.naturalWidth > 8)) return true;
      sheet.clearRect(0, 0, 8, 8);
      sheet.drawImage(image, 0, 0, 8, 8);
      return sheet.getImageData(4, 4, 1, 1).data[3] !== 255;
    }).length;
    result.views = document.querySelectorAll(".view.live").length;
    result.sideways = document.documentElement.scrollWidth > window.innerWidth;

    const box = document.querySelector(".wipe"), over = box.querySelector(".over");
    const range = box.parentNode.querySelector("input");
    const at = box.getBoundingClientRect();
    const pointer = (target, type, x, y, buttons) => target.dispatchEvent(new PointerEvent(type,
      { clientX: x, clientY: y, buttons, pointerId: 1, bubbles: true, cancelable: true }));
    pointer(box, "pointerdown", at.left + 0.25 * at.width, at.top + 5, 1);
    result.wiped = [Number(range.value), over.style.clipPath];
    range.value = 80;
    range.dispatchEvent(new Event("input"));
    result.slid = over.style.clipPath;
    const before = over.src;
    document.querySelector('figure[data-part="error"]').click();
    result.chosen = over.src !== before && box.querySelector(".right").textContent;

    const canvas = document.querySelector(".plot canvas"), context = canvas.getContext("2d");
    canvas.scrollIntoView();
    const pixels = () => context.getImageData(0, 0, canvas.width, canvas.height).data;
    const near = (data, r, g, b) => {
      let n = 0;
      for (let i = 0; i < data.length; i += 4)
        n += data[i + 3] > 200 && Math.abs(data[i] - r) + Math.abs(data[i + 1] - g) + Math.abs(data[i + 2] - b) < 30;
      return n;
    };
    const differs = (a, b) => a.some((value, i) => value !== b[i]);
    await wait();
    const first = pixels();
    const style = getComputedStyle(document.documentElement);
    const colour = (name) => style.getPropertyValue(name).trim().slice(1).match(/../g).map((x) => parseInt(x, 16));
    result.train = near(first, ...colour("--train"));
    result.held_out = near(first, ...colour("--held-out"));
    const place = canvas.getBoundingClientRect();
    const x = place.left + place.width / 2, y = place.top + place.height / 2;
    pointer(canvas, "pointerdown", x, y, 1);
    pointer(canvas, "pointermove", x + 60, y + 20, 1);
    pointer(canvas, "pointerup", x + 60, y + 20, 0);
    await wait();
    const turned = pixels();
    result.turned = differs(first, turned);
    canvas.dispatchEvent(new WheelEvent("wheel", { deltaY: -300, bubbles: true, cancelable: true }));
    await wait();
    result.zoomed = differs(turned, pixels());
    canvas.dispatchEvent(new MouseEvent("dblclick"));
    await wait();
    result.back = !differs(first, pixels());
    const names = new Set(), output = document.querySelector(".plot output");
    for (let i = 0; i < place.width; i += 8)
      for (let j = 0; j < place.height; j += 8) {
        pointer(canvas, "pointermove", place.left + i, place.top + j, 0);
        if (output.textContent) names.add(output.textContent);
      }
    result.names = [...names];
  } catch (error) {
    result.error = String(error);
  }
  result.error = result.error || document.documentElement.dataset.error || "";
  result.ready = document.documentElement.dataset.ready || "";
  document.documentElement.dataset.result = encodeURIComponent(JSON.stringify(result));
})();
</script>
)";

std::string browser() {
  for (const char* name : {"chromium-headless-shell", "chromium", "google-chrome"}) {
    const ProgramResult found = run_program("/bin/sh", {"-c", "command -v " + std::string(name)});
    if (found.exit_code == 0) return found.out.substr(0, found.out.find('\n'));
  }
  return "";
}

std::string percent_decoded(const std::string& text) {
  std::string out;
  for (size_t i = 0; i < text.size(); ++i) {
    if (text[i] == '%' && i + 2 < text.size()) {
      out += static_cast<char>(std::stoi(text.substr(i + 1, 2), nullptr, 16));
      i += 2;
    } else {
      out += text[i];
    }
  }
  return out;
}

class ReportInABrowser : public testing_apps::NerfTrain {
 protected:
  // What the reader found in the report of the run, in a window of that width.
  nlohmann::json read_report(const std::string& program, int width) {
    std::string page = file("report.html");
    const size_t end = page.rfind("</body>");
    EXPECT_NE(end, std::string::npos);
    page.insert(end, kReader);
    const fs::path copy = fs::path(run_folder()) / "read.html";
    testing_apps::write_text(copy, page);
    const ProgramResult result = run_program(
        program, {"--headless", "--no-sandbox", "--disable-gpu", "--dump-dom",
                  "--user-data-dir=" + run_folder("browser"), "--virtual-time-budget=20000",
                  "--window-size=" + std::to_string(width) + ",800", "file://" + copy.string()});
    EXPECT_EQ(result.exit_code, 0) << result.err;
    const std::string lead = "data-result=\"";
    const size_t at = result.out.find(lead);
    if (at == std::string::npos) {
      ADD_FAILURE() << "the page was not read to its end\n" << result.err;
      return {};
    }
    const size_t begin = at + lead.size();
    return nlohmann::json::parse(
        percent_decoded(result.out.substr(begin, result.out.find('"', begin) - begin)));
  }
};

TEST_F(ReportInABrowser, ShowsItsPicturesAndMoves) {
  const std::string program = browser();
  ASSERT_FALSE(program.empty()) << "no browser is installed that this test can use: "
                                   "scripts/install-deps installs chromium-headless-shell";
  const ProgramResult trained = train(testing_apps::tiny(
      {scene(), "-o", run_folder(), "--steps", "40", "--report-every", "10", "--threads", "1"}));
  ASSERT_EQ(trained.exit_code, 0) << trained.err;
  for (const int width : {1200, 390}) {
    const nlohmann::json r = read_report(program, width);
    SCOPED_TRACE(std::to_string(width) + ": " + r.dump());
    ASSERT_TRUE(r.is_object());
    EXPECT_EQ(r["error"], "");
    EXPECT_EQ(r["ready"], "yes");
    EXPECT_EQ(r["views"], 2);
    EXPECT_EQ(r["images"], 2 * 6);  // four, and two of the wipe
    EXPECT_EQ(r["empty"], 0);
    EXPECT_EQ(r["sideways"], false);  // no part is wider than the screen
    EXPECT_NEAR(r["wiped"][0].get<double>(), 25, 0.5);
    EXPECT_TRUE(r["wiped"][1].get<std::string>().starts_with("inset(0px 0px 0px 25"));
    EXPECT_EQ(r["slid"], "inset(0px 0px 0px 80%)");
    EXPECT_EQ(r["chosen"], "error");
    EXPECT_GT(r["train"], 20);
    EXPECT_GT(r["held_out"], 10);
    EXPECT_EQ(r["turned"], true);
    EXPECT_EQ(r["zoomed"], true);
    EXPECT_EQ(r["back"], true);
    EXPECT_GE(r["names"].size(), 6u);
    EXPECT_NE(r["names"].dump().find("(held out)"), std::string::npos);
  }
}

}  // namespace
}  // namespace nerf
