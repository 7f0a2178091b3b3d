#include "score_text.h"

#include <fmt/format.h>

namespace nerf::apps {

const char* held_out_name(HeldOut kind) { return kind == HeldOut::kTime ? "time" : "space"; }

std::vector<std::string> score_lines(const Evaluation& e) {
  std::vector<std::string> lines;
  if (e.counted > 0)
    lines.push_back(fmt::format(
        "held out    PSNR {:.2f} dB, SSIM {:.4f}, mean of {} views{}", e.psnr, e.ssim, e.counted,
        e.halves ? " (right halves, in a light that fits the left ones)" : ""));
  for (const HeldOutScore& s : e.held_out)
    lines.push_back(fmt::format("  in {:<9}PSNR {:.2f} dB, SSIM {:.4f}, mean of {} views of {}",
                                held_out_name(s.held_out), s.psnr, s.ssim, s.counted,
                                s.held_out == HeldOut::kTime
                                    ? "moments that training has not seen"
                                    : "moments that training saw from elsewhere"));
  if (e.scales.size() > 1)
    for (const ScaleScore& s : e.scales)
      lines.push_back(fmt::format("  at 1/{:<6} PSNR {:.2f} dB, SSIM {:.4f}, mean of {} views",
                                  s.scale, s.psnr, s.ssim, s.counted));
  if (e.aligned)
    lines.push_back(fmt::format(
        "  aligned     PSNR {:.2f} dB, SSIM {:.4f}: from where a fit by each photo puts its camera",
        e.aligned_psnr, e.aligned_ssim));
  return lines;
}

}  // namespace nerf::apps
