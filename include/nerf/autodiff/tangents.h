// Derivatives of values along given directions, as values: for losses on a derivative, such as the
// elastic loss on a warp's Jacobian (Park et al. 2021, section 3.3) or normals, the gradient of
// density. They go forward through the same operations as the values they belong to, so that the
// backward pass goes through both.
#pragma once

#include <span>
#include <vector>

#include "nerf/autodiff/operations.h"
#include "nerf/base/real.h"

namespace nerf {

struct WithTangents {
  Value value = 0;
  std::vector<Value> tangents;  // d value / d direction, one for each direction; shaped as value
};

// The operations of operations.h; tangents are the exact derivatives. A ReLU's is 0 at 0.
WithTangents linear(Tape& tape, const WithTangents& x, const LinearWeights& w,
                    LinearActivation activation);
WithTangents mlp(Tape& tape, WithTangents x, std::span<const LinearWeights> layers);
WithTangents concat(Tape& tape, const WithTangents& a, const WithTangents& b);
// The same beside what is the same in every direction, such as a code or a view: [rows of a + rows
// of b x n], whose tangents are 0 in the rows of the constant, whatever stands there. The constant
// may need a gradient, which it gets through the value.
WithTangents concat(Tape& tape, const WithTangents& a, Value constant);
WithTangents concat(Tape& tape, Value constant, const WithTangents& b);
WithTangents slice(Tape& tape, const WithTangents& x, int first, int rows);
// The value's times x's: exact up to 30, where the value stays, and of that size beyond, so that an
// extreme density does not go dead. Gradients through the value have the slope of |x| <= 15.
WithTangents truncated_exp(Tape& tape, const WithTangents& x);
WithTangents sigmoid(Tape& tape, const WithTangents& x);
WithTangents softplus(Tape& tape, const WithTangents& x, Real shift);
WithTangents relu(Tape& tape, const WithTangents& x);
WithTangents add(Tape& tape, const WithTangents& a, const WithTangents& b);
WithTangents multiply(Tape& tape, const WithTangents& a, const WithTangents& b);
// The same with what is the same in every direction.
WithTangents multiply(Tape& tape, const WithTangents& a, Value constant);
WithTangents scale_shift(Tape& tape, const WithTangents& x, Real factor, Real shift);
WithTangents frequency_encoding(Tape& tape, const WithTangents& x, std::span<const Real> weights,
                                bool identity);
// The same with weights that may change between passes, as operations.h has it. Tangents are those
// of the weights that the forward pass found.
WithTangents frequency_encoding(Tape& tape, const WithTangents& x, const FrequencyWeights& weights,
                                bool identity);
WithTangents rigid_motion(Tape& tape, const WithTangents& screw, const WithTangents& x);
// [d x rays] -> [d x samples], tangents too: a ray's column for each of its samples.
WithTangents repeat_for_samples(Tape& tape, const WithTangents& x);

}  // namespace nerf
