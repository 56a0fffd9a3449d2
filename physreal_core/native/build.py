"""A Warp module that may call C++ headers of ours: compiled by Warp's own compilers, so no other is needed."""

from pathlib import Path

import warp as wp

wp.config.log_level = wp.LOG_WARNING  # else Warp's banner and compile notes run through every progress bar
SHARED = Path(__file__).parent
# Products and sums may fuse; there is no fast-math: NaN and infinity keep their meaning, a state that blew up must be seen.
# 512: else clang splits the vectors in two on some processors.
# -Wno-psabi: vectors wider than the registers are passed between our own templates only, never over an ABI.
_FLAGS = "-ffp-contract=fast -mprefer-vector-width=512 -Wno-psabi"


def native_module(
    name: str, header: Path, *folders: Path, preamble: str = "", cuda: bool = False, machine: str | None = None
) -> wp.Module:
    """Warp module `name` with `header` included before its kernels, and without Warp's own adjoints.

    Every header beside `header`, beside this file or in `folders` can be included by its bare name and is part of the
    module's hash. A kernel calls an entry point through a `wp.func_native` of one line. The headers see no C or C++ library.

    Args:
        name: name of the Warp module; one module is one compilation.
        header: the header that the others are included from.
        folders: where else to look for headers.
        preamble: C++ before `header`, which may include others.
        cuda: whether `header` is for CUDA too.
        machine: the compiler's flags for the processor; Warp's own, that is this machine's instruction set, where None.
    """
    folders = [header.parent, *folders, SHARED]
    paths = [str(folder) for folder in folders]
    preamble = f'{preamble}\n#include "{header.name}"'
    options = wp.ModuleBuildOptions(
        extra_cpu_preamble=preamble,
        extra_cpu_include_dirs=paths,
        extra_cuda_preamble=preamble if cuda else "",
        extra_cuda_include_dirs=paths if cuda else None,
        extra_build_dependencies=[str(file) for folder in folders for file in sorted(folder.rglob("*.h"))],
    )
    flags = f"{wp.config.cpu_compiler_flags if machine is None else machine} {_FLAGS}"
    module = wp.get_module(name)
    wp.set_module_options(
        {
            "enable_backward": False,
            "optimization_level": 3,
            "cpu_compiler_flags": flags,
            "extra_build_options": options,
        },
        module=module,
    )
    return module
