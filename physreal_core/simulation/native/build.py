"""The Warp module that compiles this folder's C++ headers: include folder, flags, and what it is rebuilt after."""

from pathlib import Path

import warp as wp

HEADERS = Path(__file__).resolve().parent
# 512: else clang splits the vectors in two on some processors.
# -Wno-psabi: vectors wider than the registers are passed between our own templates only, never over an ABI.
FLAGS = "-ffp-contract=fast -mprefer-vector-width=512 -Wno-psabi"


def native_module(family: str, dtype: str, header: str, flags: str | None = None) -> wp.Module:
    """Warp module whose kernels may call what `header` declares, through one-line `wp.func_native` snippets.

    Products and sums may fuse; there is no fast-math, so that what is not a number stays so. Any change of a header
    here rebuilds the module.

    Args:
        family: what the kernels are for; the module's name.
        dtype: "float32" or "float64", the second half of the name.
        header: file name of a header of this folder, or the whole path of one elsewhere.
        flags: machine flags of the compiler; Warp's own, that is the host's instruction set, where None.
    """
    module = wp.get_module(f"physreal_native_{family}_{dtype}")
    dependencies = {*HEADERS.rglob("*.h"), HEADERS / header}
    build = wp.ModuleBuildOptions(
        extra_cpu_preamble=f'#include "{header}"\n',
        extra_cpu_include_dirs=[str(HEADERS)],
        extra_build_dependencies=sorted(str(path) for path in dependencies),
    )
    machine = wp.config.cpu_compiler_flags if flags is None else flags
    options = {
        "enable_backward": False,
        "cpu_compiler_flags": f"{machine} {FLAGS}",
        "extra_build_options": build,
    }
    wp.set_module_options(options, module=module)
    return module
