// Lanes<S, N>: N numbers of type S that go through the same arithmetic at once, in as many vector registers as the
// machine needs for them, and the elementary functions on them. Operators act lane by lane; a comparison gives a Mask,
// and `mask ? a : b` chooses lane by lane. Nothing here hides a NaN: it goes through every function.
#pragma once
#include "number.h"

namespace physreal {

// Lanes that fill a register of this machine with floats; the usual width, for double too.
#if defined(__AVX512F__)
constexpr int LANES = 16;
#elif defined(__AVX__)
constexpr int LANES = 8;
#else
constexpr int LANES = 4;
#endif

template <class S, int N = LANES>
using Lanes = S __attribute__((ext_vector_type(N)));

template <class S, int N>
struct LaneTraits<S __attribute__((ext_vector_type(N)))> {
    using Scalar = S;
    using Mask = Lanes<typename Number<S>::Integer, N>;
    static constexpr int COUNT = N;
};

// The same bits as another type of the same size.
template <class To, class From>
inline To bits_as(From from) {
    static_assert(sizeof(To) == sizeof(From));
    return __builtin_bit_cast(To, from);
}

template <class S, int N = LANES>
inline Lanes<S, N> load(const S* from) {
    Lanes<S, N> value;
    __builtin_memcpy(&value, from, sizeof(value));
    return value;
}

template <class S, int N>
inline void store(S* to, Lanes<S, N> value) {
    __builtin_memcpy(to, &value, sizeof(value));
}

// 0, 1, 2, ...
template <class S, int N>
inline Lanes<S, N> iota() {
    Lanes<S, N> value;
    for (int i = 0; i < N; ++i) value[i] = S(i);
    return value;
}

template <class V>
inline V abs(V x) {
    return __builtin_elementwise_abs(x);
}
template <class V>
inline V sqrt(V x) {
    return __builtin_elementwise_sqrt(x);
}
template <class V>
inline V ceil(V x) {
    return __builtin_elementwise_ceil(x);
}
template <class V>
inline V floor(V x) {
    return __builtin_elementwise_floor(x);
}

// 1 / sqrt(x) to about two ulp, 0 < x < infinity.
template <class V>
inline V inverse_sqrt(V x) {
    return Scalar<V>(1) / sqrt(x);
}

#if defined(__AVX512F__)
// Here the processor has an estimate of 14 bits: with a step of Newton's twice as fast as root and division.
template <>
inline Lanes<float, 16> inverse_sqrt(Lanes<float, 16> x) {
    const Lanes<float, 16> estimate = __builtin_ia32_rsqrt14ps512_mask(x, x, 0xffff);
    return estimate + 0.5f * estimate * (1.0f - x * estimate * estimate);
}
#endif

template <class M>
inline bool any(M mask) {
    return __builtin_reduce_or(mask) != 0;
}
template <class M>
inline bool all(M mask) {
    return __builtin_reduce_and(mask) != 0;
}

// Sum over the lanes, by halves: the order does not depend on the machine.
template <class S, int N>
inline S sum(Lanes<S, N> value) {
    if constexpr (N == 1)
        return value[0];
    else
        return sum<S, N / 2>(value.lo + value.hi);
}

// Sums over the lanes of N vectors, each in the lane of its place.
template <class S, int N>
inline Lanes<S, N> sums(const Lanes<S, N> (&values)[N]) {
    Lanes<S, N> level[N];
    for (int i = 0; i < N; ++i) level[i] = values[i];
#pragma unroll
    for (int count = N / 2; count > 0; count /= 2)
#pragma unroll
        for (int i = 0; i < count; ++i) {
            const Lanes<S, N> a = level[2 * i], b = level[2 * i + 1];
            Lanes<S, N> even, odd;
            even.lo = a.even, even.hi = b.even, odd.lo = a.odd, odd.hi = b.odd;
            level[i] = even + odd;
        }
    return level[0];
}

// Bit i of the result is lane i of the mask.
template <class I>
inline unsigned bits(Lanes<I, 16> mask) {
    using Bools = bool __attribute__((ext_vector_type(16)));
    return __builtin_bit_cast(unsigned short, __builtin_convertvector(mask, Bools));
}
template <class I, int N>
inline unsigned bits(Lanes<I, N> mask) {
    unsigned found = 0;
    for (int i = 0; i < N; ++i) found |= unsigned(mask[i] != 0) << i;
    return found;
}

// Numbers at places of an array.
template <class S, int N = LANES>
inline Lanes<S, N> gather(const S* from, const int* places) {
    Lanes<S, N> value;
    for (int i = 0; i < N; ++i) value[i] = from[places[i]];
    return value;
}
template <class S, int N>
inline void scatter(S* to, const int* places, Lanes<S, N> value) {
    for (int i = 0; i < N; ++i) to[places[i]] = value[i];
}
// Those of N numbers whose bits are set, one after the other, and anything behind them up to N.
template <int N = LANES>
inline void put_set(int* to, const int* from, unsigned set) {
    for (; set; set &= set - 1) *to++ = from[__builtin_ctz(set)];
}

#if defined(__AVX512F__)
// The same in one instruction each.
template <>
inline Lanes<float, 16> gather<float, 16>(const float* from, const int* places) {
    return __builtin_ia32_gathersiv16sf(Lanes<float, 16>{}, from, load<int, 16>(places), 0xffff, sizeof(float));
}
template <>
inline void scatter<float, 16>(float* to, const int* places, Lanes<float, 16> value) {
    __builtin_ia32_scattersiv16sf(to, 0xffff, load<int, 16>(places), value, sizeof(float));
}
template <>
inline void put_set<16>(int* to, const int* from, unsigned set) {
    store<int, 16>(to, __builtin_ia32_compresssi512_mask(load<int, 16>(from), Lanes<int, 16>{}, set));
}
#endif

// Natural logarithm, below one ulp: log(2^k (1 + f)) by the odd series in s = f / (2 + f) of fdlibm (Sun Microsystems,
// e_log.c). Minus infinity at 0, NaN below.
template <class V>
inline V log(V x) {
    using T = Number<Scalar<V>>;
    using S = Scalar<V>;
    using I = Mask<V>;
    const Mask<V> subnormal = x < T::SMALLEST_NORMAL;
    const S lift = S(1ll << T::MANTISSA_BITS);
    const I bits = bits_as<I>(select(subnormal, x * lift, x));
    const I half_root = bits_as<I>(splat<V>(S(0.70710678118654752)));
    const I exponent = (bits - half_root) >> T::MANTISSA_BITS;  // so that sqrt(1/2) <= mantissa < sqrt(2)
    const V mantissa = bits_as<V>(bits - (exponent << T::MANTISSA_BITS));
    const V integer = splat<V>(T::ROUNDS_TO_INTEGER);
    V k = bits_as<V>(bits_as<I>(integer) + exponent) - integer;
    k = select(subnormal, k - S(T::MANTISSA_BITS), k);
    const V f = mantissa - S(1);
    const V s = f / (f + S(2));
    const V z = s * s;
    constexpr int terms = sizeof(T::LOG_SERIES) / sizeof(S);
    V series = splat<V>(T::LOG_SERIES[terms - 1]);
    for (int i = terms - 2; i >= 0; --i) series = series * z + T::LOG_SERIES[i];
    const V half_square = S(0.5) * f * f;
    V value = k * T::LN2_HIGH - ((half_square - (s * (half_square + z * series) + k * T::LN2_LOW)) - f);
    const V unbounded = splat<V>(infinity<S>());
    value = select(x < unbounded, value, x);  // infinity and NaN are their own logarithms
    value = select(x == S(0), -unbounded, value);
    return select(x < S(0), splat<V>(not_a_number<S>()), value);
}

// Exponential, about one ulp: 2^k times Taylor's polynomial on |r| <= log(2) / 2.
template <class V>
inline V exp(V x) {
    using T = Number<Scalar<V>>;
    using S = Scalar<V>;
    using I = Mask<V>;
    x = select(x > T::EXP_HIGHEST, splat<V>(T::EXP_HIGHEST), x);
    x = select(x < T::EXP_LOWEST, splat<V>(T::EXP_LOWEST), x);
    const V integer = splat<V>(T::ROUNDS_TO_INTEGER);
    const V shifted = x * S(1.44269504088896340736) + integer;
    const V k = shifted - integer;
    const V r = (x - k * T::LN2_HIGH) - k * T::LN2_LOW;
    V value = splat<V>(inverse_factorial<S>(T::EXP_TERMS));
    for (int i = T::EXP_TERMS - 1; i >= 0; --i) value = value * r + inverse_factorial<S>(i);
    // 2^k in two factors: either alone is in range where the result is subnormal or infinite
    const I exponent = bits_as<I>(shifted) - bits_as<I>(integer);
    const I half = exponent >> 1;
    const V low = bits_as<V>((half + T::EXPONENT_BIAS) << T::MANTISSA_BITS);
    const V high = bits_as<V>((exponent - half + T::EXPONENT_BIAS) << T::MANTISSA_BITS);
    return value * low * high;
}

// 2^x for x between the smallest and the largest exponent of a normal number; beyond them the result means nothing. Two
// ulp.
template <class V>
inline V exp2_between(V x) {
    using T = Number<Scalar<V>>;
    using S = Scalar<V>;
    using I = Mask<V>;
    constexpr int terms = sizeof(S) == 4 ? 6 : 13;
    const V integer = splat<V>(T::ROUNDS_TO_INTEGER);
    const V shifted = x + integer;
    const V r = x - (shifted - integer);
    S coefficients[terms + 1] = {S(1)};
    for (int i = 1; i <= terms; ++i) coefficients[i] = coefficients[i - 1] * S(0.6931471805599453) / S(i);
    V p = splat<V>(coefficients[terms]);
#pragma unroll
    for (int i = terms - 1; i >= 0; --i) p = p * r + coefficients[i];
    return p * bits_as<V>((bits_as<I>(shifted) + T::EXPONENT_BIAS) << T::MANTISSA_BITS);
}

// Sine and cosine, about one ulp while |x| is below some thousand: Taylor's polynomials on |r| <= pi / 4.
template <class V>
inline void sin_cos(V x, V& sine, V& cosine) {
    using T = Number<Scalar<V>>;
    using S = Scalar<V>;
    using I = Mask<V>;
    const V integer = splat<V>(T::ROUNDS_TO_INTEGER);
    const V shifted = x * S(0.63661977236758134308) + integer;
    const V k = shifted - integer;
    const V r = (x - k * T::HALF_PI_HIGH) - k * T::HALF_PI_LOW;
    const V z = -r * r;
    V odd = splat<V>(inverse_factorial<S>(2 * T::SIN_TERMS - 1));
    V even = splat<V>(inverse_factorial<S>(2 * T::SIN_TERMS));
    for (int i = T::SIN_TERMS - 2; i >= 1; --i) odd = odd * z + inverse_factorial<S>(2 * i + 1);
    for (int i = T::SIN_TERMS - 1; i >= 1; --i) even = even * z + inverse_factorial<S>(2 * i);
    odd = r + r * (z * odd);
    even = S(1) + z * even;
    const I quarter = bits_as<I>(shifted) & 3;
    const I swapped = (quarter & 1) != 0;
    sine = select(swapped, even, odd);
    cosine = select(swapped, odd, even);
    sine = select((quarter & 2) != 0, -sine, sine);
    cosine = select(((quarter + 1) & 2) != 0, -cosine, cosine);
}

// Angle of (x, y) from -pi to pi, about two ulp: atan by the rational function of Cephes (Moshier, atan.c) between 0 and
// tan(pi / 8), where the angles above lead to it.
template <class V>
inline V atan2(V y, V x) {
    using S = Scalar<V>;
    const V up = abs(y), right = abs(x);
    const Mask<V> steep = up > right;
    const V low = select(steep, right, up), high = select(steep, up, right);
    const V safe = select(high > S(0), high, splat<V>(S(1)));
    const V ratio = low / safe;
    const Mask<V> large = ratio > S(0.4142135623730950);
    const V t = select(large, (ratio - S(1)) / (ratio + S(1)), ratio);
    const V z = t * t;
    constexpr S P[] = {S(-8.750608600031904122785e-1), S(-1.615753718733365076637e1), S(-7.500855792314704667340e1),
                       S(-1.228866684490136173410e2), S(-6.485021904942025371773e1)};
    constexpr S Q[] = {S(2.485846490142306297962e1), S(1.650270098316988542046e2), S(4.328810604912902668951e2),
                       S(4.853903996359136964868e2), S(1.945506571482613964425e2)};
    V above = splat<V>(P[0]), below = z + Q[0];
    for (int i = 1; i < 5; ++i) above = above * z + P[i], below = below * z + Q[i];
    V angle = t + t * (z * above / below) + select(large, splat<V>(S(0.78539816339744830962)), V{});
    angle = select(steep, S(1.57079632679489661923) - angle, angle);
    angle = select(x < S(0), S(3.14159265358979323846) - angle, angle);
    angle = select(y < S(0), -angle, angle);
    return angle + (y - y) + (x - x);  // not a number stays
}

}  // namespace physreal
