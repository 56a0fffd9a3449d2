// The functions of one number that the projection and the compositing need.
#pragma once

namespace physreal {

using wp::ceil;
using wp::floor;
using wp::log;
using wp::sqrt;

// 2^x for x <= 0; the single-precision one is the machine's own, within 2 units in the last place.
inline float exp2_of(float x) {
#if defined(__CUDA_ARCH__)
  float y;
  asm("ex2.approx.ftz.f32 %0, %1;" : "=f"(y) : "f"(x));
  return y;
#else
  return wp::exp(x * 0.69314718f);
#endif
}
inline double exp2_of(double x) { return wp::exp(x * 0.6931471805599453); }

inline float quotient(float a, float b) {
#if defined(__CUDA_ARCH__)
  return __fdividef(a, b);
#else
  return a / b;
#endif
}
inline double quotient(double a, double b) { return a / b; }

inline unsigned bits_of(float x) {
#if defined(__CUDA_ARCH__)
  return __float_as_uint(x);
#else
  return __builtin_bit_cast(unsigned, x);
#endif
}
inline unsigned bits_of(double x) { return bits_of(float(x)); }

}  // namespace physreal
