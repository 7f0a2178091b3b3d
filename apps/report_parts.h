// The parts of a run's report, each as HTML; empty where the record holds nothing of it.
#pragma once

#include <string>

#include "nerf/base/threads.h"
#include "run_record.h"

namespace nerf::apps {

std::string curves_part(const RunRecord& record);
std::string space_part(const RunRecord& record);    // cameras and points
std::string light_part(const RunRecord& record);    // exposures, vignetting
std::string medium_part(const RunRecord& record);   // that was learnt
std::string time_part(const RunRecord& record);     // timing by stage, memory
std::string skipped_part(const RunRecord& record);  // what was left out
std::string options_part(const RunRecord& record);

// Pictures that cannot be read are named in `problems`.
std::string views_part(const RunRecord& record, ThreadPool& pool,
                       std::vector<std::string>& problems);

// The id of the view's element in the page, by its index in RunRecord::views.
std::string view_id(size_t index);

// 30.13 dB, 0.8504, 527.95 s and the like: with so many decimals, or an en dash for none.
std::string figure(std::optional<double> value, int decimals, const std::string& unit = "");
// 380.9 M, 62.5 k.
std::string count_text(double count);

}  // namespace nerf::apps
