// Objects in nerf_render's pictures, from the command line.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "nerf/base/options.h"
#include "nerf/base/threads.h"
#include "nerf/io/object_file.h"
#include "nerf/math/option_types.h"
#include "nerf/model/insertion.h"
#include "nerf/model/radiance_field.h"

namespace nerf::apps {

struct InsertOptions {
  std::filesystem::path insert;
  std::optional<Vec3d> at;
  std::string place;
  double scale = 1;
  Vec3d rotate;
  std::string light;  // as parse_lights() takes it
  bool field_light = true;
  bool object_shadow = true;
  std::string object_animation;
  double object_start = 0;
  bool object_loop = true;

  template <class V>
  void visit_options(V& v) {
    v.heading("An object in the scene");
    v("insert", insert,
      "a glTF object that stands in the scene; without --at and --place in the coordinates of "
      "nerf_export's GLB files",
      metavar("FILE"), brief("a glTF object that stands in the scene"));
    v("at", at, "where its origin is, input coordinates; it stands upright");
    v("place", place,
      "stands it on the surface under a pixel of a view, by the middle of its underside: NAME@X,Y "
      "in pixels of that photo at the size trained on, or NAME@X%,Y% of its width and height; "
      "floor stands for the first one's name",
      metavar("VIEW@X,Y"), brief("stands it on what pixel X,Y of a photo shows"));
    v("scale", scale, "input units that a metre of the object is", above(0), at_most(1e9));
    v("rotate", rotate, "degrees about its own x, y (up) and z, in this order");
    v("light", light,
      "a light from far away in this direction, input coordinates, and what a white surface shows "
      "that faces it, red, green and blue (linear); without these that is the direction's length. "
      "May be given several times",
      repeatable(), metavar("X,Y,Z[:R,G,B]"));
    v("field_light", field_light, "the scene's own light on the object");
    v("object_shadow", object_shadow, "the object's shadow on the scene");
    v("object_animation", object_animation,
      "which of the object's animations plays, by its name; without it the first, with those that "
      "move other parts",
      metavar("NAME"));
    v("object_start", object_start,
      "seconds by which the object's animation is ahead of the film; --fps says how fast frames "
      "follow",
      at_least(0), at_most(1e6), metavar("S"));
    v("object_loop", object_loop,
      "the object's animation begins again at its end; --no-object-loop: stays there");
  }
  // Throws Error for combinations that cannot be.
  void check_options() const;
};

// VIEW@X,Y, either of them in percent.
struct PlacePixel {
  std::string view;
  Vec2d pixel;
  bool percent_x = false, percent_y = false;
};
std::optional<PlacePixel> parse_place(const std::string& text);

// Lights of --light, X,Y,Z or X,Y,Z:R,G,B with spaces between them. Their directions are input
// coordinates. Throws Error.
std::vector<DistantLight> parse_lights(const std::string& text);

// From the object's coordinates to input coordinates. Throws Error where the place shows no
// surface.
Similarity object_to_input(const InsertOptions& options, const RadianceField& field,
                           const SceneObject& object, const RenderOptions& render,
                           ThreadPool& pool);

// Where an animation whose keys are from `first` to `last` is at `seconds` of the same clock:
// before them at the first, after them again and again from there, or at the last.
double played_time(double seconds, double first, double last, bool loop);

struct InsertedObject {
  std::unique_ptr<Insertion> insertion;  // null: none is wanted
  std::vector<std::string> notes;

  // Moves the object to where it is so many seconds into the film, and lights it there. Costs
  // nothing where it stands still or was shown at that time before.
  void show(double seconds, const RenderOptions& render, ThreadPool& pool);

  std::unique_ptr<ObjectMotion> motion;  // null: it stands still
  TriangleMesh mesh;                     // where it was shown last, its own coordinates
  double shown = 0;                      // at that moment of its animation
  Similarity to_engine;                  // from there
  double start = 0;
  bool loop = true;
};

// Reads the object and stands it in the field as it is so many seconds into the film. Throws Error.
InsertedObject insert_object(const InsertOptions& options, const RadianceField& field,
                             double seconds, const RenderOptions& render, ThreadPool& pool);

}  // namespace nerf::apps
