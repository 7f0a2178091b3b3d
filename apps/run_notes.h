// What a report shows of a training besides its result: its command, what it printed, its points.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "nerf/io/scene.h"
#include "nerf/math/vec.h"

namespace nerf::apps {

struct RunNotes {
  std::string command;             // as it was given
  std::string repeat;              // gives the same result again; empty until the end
  std::vector<std::string> scene;  // the lines of format_report()
  std::vector<std::string> warnings;
  std::vector<std::string> printed;  // every line
  // Sparse points of the capture, at most kMostPoints, spread evenly over their list. Level
  // coordinates: +z up, centred as the engine's, in the capture's unit.
  std::vector<Vec3d> points;
  int64_t points_total = 0;
};

inline constexpr size_t kMostPoints = 5000;

// Of a scene that has been read; what was printed is added by the caller.
RunNotes notes_of(const Scene& scene);

// The command line that the program was called with, as a shell reads it.
std::string command_text(int argc, const char* const* argv);

// RUN/notes.json. Written atomically.
void write_notes(const std::filesystem::path& path, const RunNotes& notes);

// Throws Error for what is no JSON; fields that are missing or of another type stay empty.
RunNotes read_notes(const std::filesystem::path& path);

// `value` with so many decimal places as a thousandth of `extent` / 10 has: short text in JSON.
double shortened_number(double value, double extent);

}  // namespace nerf::apps
