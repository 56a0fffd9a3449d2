"""Texts to vectors by an ONNX network and its tokenizer.json: sentence encoders (MiniLM) and CLIP's text side."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from physreal_core.array_types import Array, Float
from physreal_core.errors import InputError
from physreal_core.perception.session import FETCH_COMMAND, open_session


class TextEncoder:
    """Encodes texts to unit vectors; each text is encoded once and remembered.

    Inputs, by name: `input_ids` [1, L]; `attention_mask` and `token_type_ids` [1, L] where the network has them. Output:
    `text_embeds` or else the first; [1, D] is taken as it is, of [1, L, D] the mean over the tokens.
    """

    def __init__(self, network: str | Path, tokenizer: str | Path, *, threads: int = 0) -> None:
        self._session = open_session(network, threads=threads, inputs=1, outputs=1)
        self._tokenizer = _open_tokenizer(tokenizer)
        names = [i.name for i in self._session.get_inputs()]
        unknown = set(names) - {"input_ids", "attention_mask", "token_type_ids"}
        if "input_ids" not in names or unknown:
            raise InputError(
                f"the text encoder has the inputs {', '.join(names)}",
                where=str(network),
                expected="input_ids, and attention_mask or token_type_ids where needed",
            )
        self._known: dict[str, Array] = {}

    def __call__(self, texts: Sequence[str]) -> Float[Array, "N D"]:
        """Unit vectors of N texts."""
        for text in texts:
            if text not in self._known:
                self._known[text] = self._encode(text)
        return np.stack([self._known[text] for text in texts])

    def _encode(self, text: str) -> Array:
        encoding = self._tokenizer.encode(text)
        values = {
            "input_ids": encoding.ids,
            "attention_mask": encoding.attention_mask,
            "token_type_ids": encoding.type_ids,
        }
        feeds = {i.name: _fitted(values[i.name], i) for i in self._session.get_inputs()}
        outputs = [o.name for o in self._session.get_outputs()]
        name = "text_embeds" if "text_embeds" in outputs else outputs[0]
        (found,) = self._session.run([name], feeds)
        vector = found[0, : len(encoding.ids)].mean(0) if found.ndim == 3 else found[0]
        return vector.astype(np.float64) / max(float(np.linalg.norm(vector)), 1e-12)


def _fitted(values: Sequence[int], wanted) -> Array:
    """[1, L] in the type and, where it is fixed, the length that the network wants; what is added is 0."""
    length = wanted.shape[1] if isinstance(wanted.shape[1], int) else len(values)
    row = np.zeros((1, length), np.int32 if "int32" in wanted.type else np.int64)
    row[0, : len(values)] = values[:length]
    return row


def _open_tokenizer(path: str | Path):
    from tokenizers import Tokenizer

    path = Path(path)
    if not path.is_file():
        raise InputError(
            "the tokenizer is missing",
            where=str(path),
            expected="a tokenizer.json",
            remedy=f"run `{FETCH_COMMAND} text`",
        )
    try:
        tokenizer = Tokenizer.from_file(str(path))
    except Exception as error:  # the library raises bare exceptions
        raise InputError(
            f"the tokenizer cannot be read ({error})", where=str(path), expected="a tokenizer.json"
        ) from error
    tokenizer.no_padding()
    return tokenizer
