// Objects in nerf_render's pictures, from the command line.
#pragma once

#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "nerf/base/options.h"
#include "nerf/base/threads.h"
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
  std::optional<Vec3d> light;
  bool field_light = true;
  bool object_shadow = true;

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
      "a light from far away in this direction, input coordinates; its length is what a white "
      "surface shows that faces it (linear)");
    v("field_light", field_light, "the scene's own light on the object");
    v("object_shadow", object_shadow, "the object's shadow on the scene");
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

// From the object's coordinates to input coordinates. Throws Error where the place shows no
// surface.
Similarity object_to_input(const InsertOptions& options, const RadianceField& field,
                           const SceneObject& object, const RenderOptions& render,
                           ThreadPool& pool);

struct InsertedObject {
  std::unique_ptr<Insertion> insertion;  // null: none is wanted
  std::vector<std::string> notes;
};

// Reads the object and stands it in the field. Throws Error.
InsertedObject insert_object(const InsertOptions& options, const RadianceField& field,
                             const RenderOptions& render, ThreadPool& pool);

}  // namespace nerf::apps
