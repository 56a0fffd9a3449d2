// A number of type V, float or double or the lanes of `lanes.h`, and the elementary functions on it, so that one source
// of a law serves a GPU's thread, which has one particle, and a CPU's, which has a register full of them. Where lanes
// are in use their header comes before the laws': names for built-in types are looked up where a template is written.
// Nothing here hides a NaN: it goes through every function.
#pragma once

// A loop that a GPU's compiler leaves as one, where unrolled it would be thousands of lines; one that it must unroll, so
// that what it indexes stays in registers; and one of which it waits for the memory of four turns at once.
#if defined(__CUDA_ARCH__)
#define ONE_AT_A_TIME _Pragma("unroll 1")
#define UNROLLED _Pragma("unroll")
#define FOUR_AT_A_TIME _Pragma("unroll 4")
#else
#define ONE_AT_A_TIME
#define UNROLLED
#define FOUR_AT_A_TIME
#endif

namespace physreal {

using Index = long long;

// Of a scalar: the signed integer that comparisons of it give, and its IEEE format.
template <class S>
struct Number;

template <>
struct Number<float> {
    using Integer = int;
    static constexpr int MANTISSA_BITS = 23, EXPONENT_BIAS = 127;
    static constexpr float ROUNDS_TO_INTEGER = 12582912.0f;  // 1.5 * 2^23: adding it leaves no bits for a fraction
    static constexpr float LN2_HIGH = 6.9313812256e-1f, LN2_LOW = 9.0580006145e-6f;  // few bits in the high part
    static constexpr float SMALLEST_NORMAL = 1.17549435e-38f;
    static constexpr float EXP_LOWEST = -104.0f, EXP_HIGHEST = 89.0f;  // beyond: 0 and infinity
    static constexpr float HALF_PI_HIGH = 1.5707855225e+0f, HALF_PI_LOW = 1.0804273188e-5f;
    static constexpr int EXP_TERMS = 8, SIN_TERMS = 5;
    static constexpr float LOG_SERIES[] = {0.66666662693f, 0.40000972152f, 0.28498786688f, 0.24279078841f};
};

template <>
struct Number<double> {
#if __SIZEOF_LONG__ == 8
    using Integer = long;
#else
    using Integer = long long;
#endif
    static constexpr int MANTISSA_BITS = 52, EXPONENT_BIAS = 1023;
    static constexpr double ROUNDS_TO_INTEGER = 6755399441055744.0;  // 1.5 * 2^52
    static constexpr double LN2_HIGH = 6.93147180369123816490e-1, LN2_LOW = 1.90821492927058770002e-10;
    static constexpr double SMALLEST_NORMAL = 2.2250738585072014e-308;
    static constexpr double EXP_LOWEST = -746.0, EXP_HIGHEST = 710.0;
    static constexpr double HALF_PI_HIGH = 1.57079632673412561417e+0, HALF_PI_LOW = 6.07710050650619224932e-11;
    static constexpr int EXP_TERMS = 13, SIN_TERMS = 9;
    static constexpr double LOG_SERIES[] = {6.666666666666735130e-1, 3.999999999940941908e-1, 2.857142874366239149e-1,
                                            2.222219843214978396e-1, 1.818357216161805012e-1, 1.531383769920937332e-1,
                                            1.479819860511658591e-1};
};

// What a V consists of: its scalar type, what a comparison gives, and how many there are.
template <class V>
struct LaneTraits;
template <>
struct LaneTraits<float> {
    using Scalar = float;
    using Mask = bool;
    static constexpr int COUNT = 1;
};
template <>
struct LaneTraits<double> {
    using Scalar = double;
    using Mask = bool;
    static constexpr int COUNT = 1;
};

template <class V>
using Scalar = typename LaneTraits<V>::Scalar;
template <class V>
using Mask = typename LaneTraits<V>::Mask;

template <class V>
inline V splat(Scalar<V> s) {
    return s - V{};
}  // x - 0 is x, also for x = -0

// `V` as it stands in memory, aligned or not.
template <class V>
inline V load(const Scalar<V>* from) {
    V value;
#if defined(__CUDA_ARCH__)
    memcpy(&value, from, sizeof(value));
#else
    __builtin_memcpy(&value, from, sizeof(value));
#endif
    return value;
}

template <class V>
inline V select(Mask<V> mask, V where_set, V elsewhere) {
    return mask ? where_set : elsewhere;
}

template <class V>
inline V min(V a, V b) {
    return a < b ? a : b;
}
template <class V>
inline V max(V a, V b) {
    return a > b ? a : b;
}

template <class S>
constexpr S inverse_factorial(int n) {
    S value = 1;
    for (int i = 2; i <= n; ++i) value /= S(i);
    return value;
}

#if defined(__CUDA_ARCH__)
template <class S>
inline S infinity() {
    return S(__int_as_float(0x7f800000));
}
template <class S>
inline S not_a_number() {
    return S(__int_as_float(0x7fffffff));
}
#else
template <class S>
constexpr S infinity() {
    return S(__builtin_inff());
}
template <class S>
constexpr S not_a_number() {
    return S(__builtin_nanf(""));
}
#endif

// --- of one number: the machine's own

inline float sqrt(float x) { return wp::sqrt(x); }
inline double sqrt(double x) { return wp::sqrt(x); }
inline float exp(float x) { return wp::exp(x); }
inline double exp(double x) { return wp::exp(x); }
inline float log(float x) { return wp::log(x); }
inline double log(double x) { return wp::log(x); }
// 1 / sqrt(x) to about two ulp, 0 < x < infinity.
inline float inverse_sqrt(float x) {
#if defined(__CUDA_ARCH__)
    return ::rsqrtf(x);
#else
    return 1 / sqrt(x);
#endif
}
inline double inverse_sqrt(double x) { return 1 / sqrt(x); }
inline float abs(float x) { return x < 0 ? -x : x; }
inline double abs(double x) { return x < 0 ? -x : x; }
inline void sin_cos(float x, float& sine, float& cosine) { sine = wp::sin(x), cosine = wp::cos(x); }
inline void sin_cos(double x, double& sine, double& cosine) { sine = wp::sin(x), cosine = wp::cos(x); }
inline float atan2(float y, float x) { return wp::atan2(y, x); }
inline double atan2(double y, double x) { return wp::atan2(y, x); }
inline bool any(bool mask) { return mask; }
inline bool all(bool mask) { return mask; }
inline float sum(float x) { return x; }
inline double sum(double x) { return x; }
inline void store(float* to, float value) { *to = value; }
inline void store(double* to, double value) { *to = value; }

}  // namespace physreal
