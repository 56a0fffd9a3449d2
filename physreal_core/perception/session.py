"""Opens ONNX networks with ONNX Runtime and says clearly what is missing or does not fit."""

from pathlib import Path

from physreal_core.cores import available_cores
from physreal_core.errors import InputError

FETCH_COMMAND = "physreal models"


def open_session(path: str | Path, *, threads: int = 0, inputs: int | None = None, outputs: int | None = None):
    """Open a network file (.onnx or .ort) on the CPU, or on CUDA where ONNX Runtime offers it.

    Args:
        path: the network file.
        threads: threads within one operator; 0: as many as the cores that this process may use.
        inputs, outputs: the least number of inputs and outputs the caller needs.

    Raises:
        InputError: the file is missing, is no network, or has too few inputs or outputs.
    """
    import onnxruntime

    path = Path(path)
    if not path.is_file():
        raise InputError(
            "network file is missing", where=str(path), expected="a .onnx or .ort file", remedy=f"run `{FETCH_COMMAND}`"
        )
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = threads or available_cores()  # by itself it takes, and pins, all of the machine's
    options.log_severity_level = 3
    wanted = ("CUDAExecutionProvider", "CPUExecutionProvider")
    providers = [p for p in wanted if p in onnxruntime.get_available_providers()]
    try:
        session = onnxruntime.InferenceSession(str(path), options, providers=providers)
    except Exception as error:  # ONNX Runtime raises many unrelated types for a file it cannot read
        raise InputError(
            f"ONNX Runtime cannot read the network ({error})", where=str(path), remedy=f"run `{FETCH_COMMAND}` again"
        ) from error
    for kind, found, least in (
        ("inputs", session.get_inputs(), inputs),
        ("outputs", session.get_outputs(), outputs),
    ):
        if least is not None and len(found) < least:
            names = ", ".join(f"{f.name} {f.shape}" for f in found)
            raise InputError(
                f"the network has the {kind} {names}", where=str(path), expected=f"at least {least} {kind}"
            )
    return session
