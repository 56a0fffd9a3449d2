"""Warp kernels of the rasteriser: EWA projection, tile lists, compositing and their hand-written adjoints.

The same source runs on CPU and CUDA; `raster_kernels(scalar)` builds it for float32 or float64. Twin: `reference.py`.
"""

from functools import cache
from types import SimpleNamespace

import warp as wp

from physreal_core.rendering.reference import ALPHA_MAX, ALPHA_MIN, LOW_PASS, NEAR, TRANSMITTANCE_MIN

# On a GPU the 32 threads of a warp walk through the same list of Gaussians: their contributions to a Gaussian are summed
# in registers and added once. All of them must get here together. On the CPU a thread is alone.
_ANY_OF_WARP = """
#if defined(__CUDA_ARCH__)
    return __any_sync(0xffffffffu, mine);
#else
    return mine;
#endif
"""
_ADD_OVER_WARP = """
    auto sum = value;
#if defined(__CUDA_ARCH__)
    for (int i = 0; i < LENGTH; ++i)
        for (int offset = 16; offset > 0; offset /= 2)
            sum[i] += __shfl_down_sync(0xffffffffu, sum[i], offset);
    if (threadIdx.x % 32 != 0) return;
#endif
    wp::atomic_add(target, index, sum);
"""


@cache
def raster_kernels(scalar: type) -> SimpleNamespace:
    """Kernels for `wp.float32` or `wp.float64`, compiled on first launch.

    Frames and units: `means` [m] and `covariances` [m^2] in the camera's frame; `intrinsics` = fx, fy, cx, cy [px];
    `limits` as `reference.jacobian_limits`; features are three colours and the depth.
    """
    wp.config.log_level = wp.LOG_WARNING  # else the banner goes to the standard output of every stage
    wp.init()
    vec2, vec3, vec4 = (wp.types.vector(n, scalar) for n in (2, 3, 4))
    vec6, mat33 = wp.types.vector(6, scalar), wp.types.matrix((3, 3), scalar)
    near, low_pass = wp.constant(scalar(NEAR)), wp.constant(scalar(LOW_PASS))
    alpha_min, alpha_max = wp.constant(scalar(ALPHA_MIN)), wp.constant(scalar(ALPHA_MAX))
    transmittance_min = wp.constant(scalar(TRANSMITTANCE_MIN))
    zero, half, one, two = (wp.constant(scalar(v)) for v in (0.0, 0.5, 1.0, 2.0))
    module = wp.get_module(f"{__name__}.{scalar.__name__}")
    module.options["enable_backward"] = False

    @wp.func_native(_ANY_OF_WARP)
    def any_of_warp(mine: bool) -> bool: ...

    @wp.func_native(_ADD_OVER_WARP.replace("LENGTH", "6"))
    def add_over_warp(target: wp.array(dtype=vec6), index: int, value: vec6): ...

    @wp.func_native(_ADD_OVER_WARP.replace("LENGTH", "4"))
    def add_over_warp(target: wp.array(dtype=vec4), index: int, value: vec4): ...  # noqa: F811

    @wp.struct
    class Splat:
        """A Gaussian on the image: alpha = opacity * exp(power), power = a dx^2 + b dx dy + c dy^2 with (a, b, c) =
        `falloff` [1/px^2]; below `power_min` alpha is under ALPHA_MIN."""

        centre: vec2
        falloff: vec3
        opacity: scalar
        power_min: scalar

    @wp.func(module=module)
    def ewa_jacobian(mean: vec3, intrinsics: vec4, limits: vec4):
        """fx / z, fy / z, d u / d z and d v / d z, with x / z and y / z kept near the field of view."""
        inverse = one / mean[2]
        x = wp.clamp(mean[0] * inverse, limits[0], limits[1])
        y = wp.clamp(mean[1] * inverse, limits[2], limits[3])
        fx = intrinsics[0] * inverse
        fy = intrinsics[1] * inverse
        return vec4(fx, fy, -fx * x, -fy * y)

    @wp.func(module=module)
    def footprint(C: mat33, J: vec4):
        """J C J^T as (xx, xy, yy), with the low-pass variance."""
        xz = half * (C[0, 2] + C[2, 0])
        yz = half * (C[1, 2] + C[2, 1])
        xy = half * (C[0, 1] + C[1, 0])
        a = J[0] * J[0] * C[0, 0] + two * J[0] * J[2] * xz + J[2] * J[2] * C[2, 2] + low_pass
        b = J[0] * J[1] * xy + J[0] * J[3] * xz + J[1] * J[2] * yz + J[2] * J[3] * C[2, 2]
        c = J[1] * J[1] * C[1, 1] + two * J[1] * J[3] * yz + J[3] * J[3] * C[2, 2] + low_pass
        return vec3(a, b, c)

    @wp.kernel(module=module)
    def project(
        means: wp.array(dtype=vec3),
        covariances: wp.array(dtype=mat33),
        opacities: wp.array(dtype=scalar),
        intrinsics: vec4,
        limits: vec4,
        tile: int,
        tiles_x: int,
        tiles_y: int,
        # Out:
        splats: wp.array(dtype=Splat),
        tile_boxes: wp.array(dtype=wp.vec4i),
        tile_counts: wp.array(dtype=wp.int32),
    ):
        g = wp.tid()
        mean = means[g]
        opacity = opacities[g]
        tile_counts[g] = 0
        if mean[2] < near or opacity < alpha_min:
            return
        J = ewa_jacobian(mean, intrinsics, limits)
        S = footprint(covariances[g], J)
        inverse = one / (S[0] * S[2] - S[1] * S[1])
        splat = Splat()
        u = intrinsics[0] * mean[0] / mean[2] + intrinsics[2]
        v = intrinsics[1] * mean[1] / mean[2] + intrinsics[3]
        splat.centre = vec2(u, v)
        splat.falloff = vec3(-half * S[2] * inverse, S[1] * inverse, -half * S[0] * inverse)
        splat.opacity = opacity
        splat.power_min = wp.log(alpha_min / opacity)
        spread = -two * splat.power_min
        # Half sizes [px] of the ellipse where alpha reaches ALPHA_MIN.
        reach = vec2(wp.sqrt(spread * S[0]), wp.sqrt(spread * S[2]))
        splats[g] = splat
        width = scalar(tiles_x * tile)
        height = scalar(tiles_y * tile)
        # Clamped before the cast: a far-off centre must not overflow an integer.
        left = int(wp.ceil(wp.clamp(u - reach[0], zero, width)))
        right = int(wp.floor(wp.clamp(u + reach[0], -one, width - one)))
        top = int(wp.ceil(wp.clamp(v - reach[1], zero, height)))
        bottom = int(wp.floor(wp.clamp(v + reach[1], -one, height - one)))
        if left > right or top > bottom:
            return
        box = wp.vec4i(left / tile, right / tile, top / tile, bottom / tile)
        tile_boxes[g] = box
        tile_counts[g] = (box[1] - box[0] + 1) * (box[3] - box[2] + 1)

    @wp.kernel(module=module)
    def list_tiles(
        order: wp.array(dtype=wp.int64),
        offsets: wp.array(dtype=wp.int64),
        tile_boxes: wp.array(dtype=wp.vec4i),
        tile_counts: wp.array(dtype=wp.int32),
        tiles_x: int,
        # Out:
        pair_tiles: wp.array(dtype=wp.int32),
        pair_splats: wp.array(dtype=wp.int32),
    ):
        """One (tile, Gaussian) pair per overlap, near Gaussians first; `offsets` end each Gaussian's run."""
        rank = wp.tid()
        g = int(order[rank])
        count = tile_counts[g]
        if count == 0:
            return
        box = tile_boxes[g]
        columns = box[1] - box[0] + 1
        first = int(offsets[rank]) - count
        for i in range(count):
            pair_tiles[first + i] = (box[2] + i / columns) * tiles_x + box[0] + i % columns
            pair_splats[first + i] = g

    @wp.kernel(module=module)
    def composite(
        starts: wp.array(dtype=wp.int32),
        pair_splats: wp.array(dtype=wp.int32),
        splats: wp.array(dtype=Splat),
        features: wp.array(dtype=vec4),
        tile: int,
        tiles_x: int,
        width: int,
        height: int,
        # Out:
        image: wp.array2d(dtype=vec4),
        transmittances: wp.array2d(dtype=scalar),
    ):
        """One thread a pixel, a tile a block: front to back until the pixel is opaque."""
        thread = wp.tid()
        index = thread / (tile * tile)
        local = thread % (tile * tile)
        px = (index % tiles_x) * tile + local % tile
        py = (index / tiles_x) * tile + local / tile
        if px >= width or py >= height:
            return
        x = scalar(px)
        y = scalar(py)
        total = vec4()
        transmittance = scalar(1.0)
        pair = starts[index]
        end = starts[index + 1]
        while pair < end and transmittance > transmittance_min:
            g = pair_splats[pair]
            pair += 1
            splat = splats[g]
            dx = x - splat.centre[0]
            dy = y - splat.centre[1]
            power = dx * (splat.falloff[0] * dx + splat.falloff[1] * dy) + splat.falloff[2] * dy * dy
            if power >= splat.power_min:
                weight = wp.min(splat.opacity * wp.exp(power), alpha_max) * transmittance
                total += weight * features[g]
                transmittance -= weight
        image[py, px] = total
        transmittances[py, px] = transmittance

    @wp.kernel(module=module)
    def composite_adjoint(
        starts: wp.array(dtype=wp.int32),
        pair_splats: wp.array(dtype=wp.int32),
        splats: wp.array(dtype=Splat),
        features: wp.array(dtype=vec4),
        tile: int,
        tiles_x: int,
        width: int,
        height: int,
        image: wp.array2d(dtype=vec4),
        transmittances: wp.array2d(dtype=scalar),
        image_bar: wp.array2d(dtype=vec4),
        transmittances_bar: wp.array2d(dtype=scalar),
        # Out:
        moments: wp.array(dtype=vec6),
        features_bar: wp.array(dtype=vec4),
    ):
        """Front to back again. `behind` is the loss carried by all that lies behind the current Gaussian, so
        d loss / d alpha = T * (feature . bar) - behind / (1 - alpha). `moments` sums q, q dx, q dy, q dx^2, q dx dy,
        q dy^2 with q = exp(power) * d loss / d alpha. Opaque pixels and those outside the image go along idly."""
        thread = wp.tid()
        index = thread / (tile * tile)
        local = thread % (tile * tile)
        px = (index % tiles_x) * tile + local % tile
        py = (index / tiles_x) * tile + local / tile
        x = scalar(px)
        y = scalar(py)
        bar = vec4()
        behind = scalar(0.0)
        transmittance = scalar(0.0)
        if px < width and py < height:
            bar = image_bar[py, px]
            behind = wp.dot(image[py, px], bar) + transmittances[py, px] * transmittances_bar[py, px]
            transmittance = scalar(1.0)
        pair = starts[index]
        end = starts[index + 1]
        while pair < end and any_of_warp(transmittance > transmittance_min):
            g = pair_splats[pair]
            pair += 1
            splat = splats[g]
            dx = x - splat.centre[0]
            dy = y - splat.centre[1]
            power = dx * (splat.falloff[0] * dx + splat.falloff[1] * dy) + splat.falloff[2] * dy * dy
            drawn = power >= splat.power_min and transmittance > transmittance_min
            if any_of_warp(drawn):
                weight = scalar(0.0)
                q = scalar(0.0)
                if drawn:
                    falloff = wp.exp(power)
                    uncapped = splat.opacity * falloff
                    alpha = wp.min(uncapped, alpha_max)
                    weight = alpha * transmittance
                    gain = wp.dot(features[g], bar)
                    behind -= weight * gain
                    if uncapped < alpha_max:
                        q = falloff * (transmittance * gain - behind / (one - alpha))
                    transmittance -= weight
                add_over_warp(features_bar, g, weight * bar)
                add_over_warp(moments, g, vec6(q, q * dx, q * dy, q * dx * dx, q * dx * dy, q * dy * dy))

    @wp.kernel(module=module)
    def project_adjoint(
        means: wp.array(dtype=vec3),
        covariances: wp.array(dtype=mat33),
        intrinsics: vec4,
        limits: vec4,
        tile_counts: wp.array(dtype=wp.int32),
        splats: wp.array(dtype=Splat),
        moments: wp.array(dtype=vec6),
        # Out:
        means_bar: wp.array(dtype=vec3),
        covariances_bar: wp.array(dtype=mat33),
        opacities_bar: wp.array(dtype=scalar),
    ):
        g = wp.tid()
        if tile_counts[g] == 0:
            return
        mean = means[g]
        inverse = one / mean[2]
        m = moments[g]
        o = splats[g].opacity
        f = splats[g].falloff
        K = vec3(-two * f[0], -f[1], -two * f[2])  # inverse of the footprint: xx, xy, yy
        opacities_bar[g] = m[0]
        u_bar = o * (K[0] * m[1] + K[1] * m[2])
        v_bar = o * (K[1] * m[1] + K[2] * m[2])
        # d loss / d conic, symmetric; then the footprint's: -K G K.
        ga = -half * o * m[3]
        gb = -half * o * m[4]
        gc = -half * o * m[5]
        ka = ga * K[0] + gb * K[1]
        kb = ga * K[1] + gb * K[2]
        kc = gb * K[0] + gc * K[1]
        kd = gb * K[1] + gc * K[2]
        sa = -(K[0] * ka + K[1] * kc)
        sb = -(K[0] * kb + K[1] * kd)
        sc = -(K[1] * kb + K[2] * kd)
        J = ewa_jacobian(mean, intrinsics, limits)
        # J^T S_bar J, J = [[J0, 0, J2], [0, J1, J3]].
        ax = sa * J[0]
        ay = sb * J[1]
        az = sa * J[2] + sb * J[3]
        bx = sb * J[0]
        by = sc * J[1]
        bz = sb * J[2] + sc * J[3]
        covariances_bar[g] = mat33(
            J[0] * ax, J[0] * ay, J[0] * az,
            J[1] * bx, J[1] * by, J[1] * bz,
            J[0] * az, J[1] * bz, J[2] * az + J[3] * bz,
        )  # fmt: skip
        # J_bar = 2 S_bar J C, only its four entries.
        C = half * (covariances[g] + wp.transpose(covariances[g]))
        j0 = two * (ax * C[0, 0] + ay * C[1, 0] + az * C[2, 0])
        j2 = two * (ax * C[0, 2] + ay * C[1, 2] + az * C[2, 2])
        j1 = two * (bx * C[0, 1] + by * C[1, 1] + bz * C[2, 1])
        j3 = two * (bx * C[0, 2] + by * C[1, 2] + bz * C[2, 2])
        x = mean[0] * inverse
        y = mean[1] * inverse
        z_bar = -inverse * (
            j0 * J[0] + j1 * J[1] + j2 * J[2] + j3 * J[3] + u_bar * J[0] * mean[0] + v_bar * J[1] * mean[1]
        )
        x_bar = u_bar * J[0]
        y_bar = v_bar * J[1]
        if x > limits[0] and x < limits[1]:
            x_bar -= j2 * J[0] * inverse
            z_bar += j2 * J[0] * x * inverse
        if y > limits[2] and y < limits[3]:
            y_bar -= j3 * J[1] * inverse
            z_bar += j3 * J[1] * y * inverse
        means_bar[g] = vec3(x_bar, y_bar, z_bar)

    return SimpleNamespace(
        Splat=Splat, scalar=scalar, vec3=vec3, vec4=vec4, vec6=vec6, mat33=mat33, project=project,
        list_tiles=list_tiles, composite=composite, composite_adjoint=composite_adjoint,
        project_adjoint=project_adjoint,
    )  # fmt: skip
