// RUN/report.html: a run to look at, in one file that needs no other and no network.
#pragma once

#include <filesystem>
#include <string>

#include "nerf/base/threads.h"
#include "run_record.h"

namespace nerf::apps {

// Held-out views whose pictures a page shows at most, and what all of them take.
inline constexpr size_t kMostReportViews = 40;
inline constexpr uint64_t kMostPictureBytes = uint64_t{14} << 20;  // JPEG; 4/3 of it as text

// The page of what the record holds; pictures are read from its folder.
std::string report_text(const RunRecord& record, ThreadPool& pool);

// Reads the run and writes its report.html, whole or not at all; the file's path. Throws Error.
std::filesystem::path write_report(const std::filesystem::path& run, ThreadPool& pool);

}  // namespace nerf::apps
