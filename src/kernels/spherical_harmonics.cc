#include "nerf/kernels/elementwise.h"

namespace nerf {

// Real spherical harmonics with the Condon-Shortley signs of the graphics literature; constants are
// sqrt((2l+1)(l-|m|)! / (4 pi (l+|m|)!)) times the polynomial's own factor.
void spherical_harmonics(Real x, Real y, Real z, Real out[kSphericalHarmonics]) {
  const Real xy = x * y, xz = x * z, yz = y * z, x2 = x * x, y2 = y * y, z2 = z * z;
  out[0] = 0.28209479177387814_r;
  out[1] = -0.48860251190291987_r * y;
  out[2] = 0.48860251190291987_r * z;
  out[3] = -0.48860251190291987_r * x;
  out[4] = 1.0925484305920792_r * xy;
  out[5] = -1.0925484305920792_r * yz;
  out[6] = 0.94617469575755997_r * z2 - 0.31539156525251999_r;
  out[7] = -1.0925484305920792_r * xz;
  out[8] = 0.54627421529603959_r * (x2 - y2);
  out[9] = 0.59004358992664352_r * y * (-3.0_r * x2 + y2);
  out[10] = 2.8906114426405538_r * xy * z;
  out[11] = 0.45704579946446572_r * y * (1.0_r - 5.0_r * z2);
  out[12] = 0.3731763325901154_r * z * (5.0_r * z2 - 3.0_r);
  out[13] = 0.45704579946446572_r * x * (1.0_r - 5.0_r * z2);
  out[14] = 1.4453057213202769_r * z * (x2 - y2);
  out[15] = 0.59004358992664352_r * x * (-x2 + 3.0_r * y2);
}

}  // namespace nerf
