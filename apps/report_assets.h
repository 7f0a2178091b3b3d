// Files of apps/report as text, embedded when the programs are built.
#pragma once

namespace nerf::apps {

extern const char* const kPageStyle;     // report/style.css, of every page
extern const char* const kReportScript;  // report/report.js

}  // namespace nerf::apps
