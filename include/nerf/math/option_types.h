// Vectors and boxes as option fields (base/options.h): "x,y,z" and "x0,y0,z0,x1,y1,z1".
#pragma once

#include "nerf/base/options.h"
#include "nerf/math/vec.h"

namespace nerf {

template <class T>
struct OptionTraits<TVec3<T>> {
  static constexpr OptionType kType = OptionType::kNumbers;
  static void describe(OptionField& f) {
    OptionTraits<T>::describe(f);
    f.count = 3;
    f.metavar = "X,Y,Z";
  }
  static OptionValue to_value(const TVec3<T>& a) {
    std::vector<double> numbers;
    for (int i = 0; i < 3; ++i)
      numbers.push_back(std::get<double>(OptionTraits<T>::to_value(a[i])));
    return numbers;
  }
  static TVec3<T> from_value(const OptionValue& v) {
    return from_numbers(std::get<std::vector<double>>(v).data());
  }
  static TVec3<T> from_numbers(const double* x) {
    return {static_cast<T>(x[0]), static_cast<T>(x[1]), static_cast<T>(x[2])};
  }
};

// Each maximum must be above its minimum.
template <>
struct OptionTraits<Box3> {
  static constexpr OptionType kType = OptionType::kNumbers;
  static void describe(OptionField& f) {
    f.count = 6;
    f.metavar = "X0,Y0,Z0,X1,Y1,Z1";
    f.problem = [](const OptionValue& v) -> std::string {
      const auto& x = std::get<std::vector<double>>(v);
      for (int i = 0; i < 3; ++i)
        if (x[i] >= x[i + 3]) return "each of x1, y1, z1 must be greater than its x0, y0, z0";
      return "";
    };
  }
  static OptionValue to_value(const Box3& b) {
    return std::vector<double>{b.min.x, b.min.y, b.min.z, b.max.x, b.max.y, b.max.z};
  }
  static Box3 from_value(const OptionValue& v) {
    const double* x = std::get<std::vector<double>>(v).data();
    return {OptionTraits<Vec3d>::from_numbers(x), OptionTraits<Vec3d>::from_numbers(x + 3)};
  }
};

}  // namespace nerf
