"""The target by its description: tiny networks made here stand for ConSE's and CLIP's, then the real ones on photographs."""

from dataclasses import replace

import numpy as np
import pytest

from physreal_core.errors import InputError
from physreal_core.perception.choices import Choice
from physreal_core.perception.frame_zero import find_object
from physreal_core.perception.motion import Motion
from physreal_core.perception.perceive import Video
from physreal_core.perception.segmenter import Candidates
from physreal_core.perception.text_choosers import ClipChooser, ConseChooser, masked_crops
from physreal_core.perception.text_encoder import TextEncoder
from pipeline.config.segment_and_track import SegmentAndTrack
from pipeline.models import check_files, default_folder
from stages import _networks

onnx = pytest.importorskip("onnx", reason="the tiny networks are made with the package onnx")
tokenizers = pytest.importorskip("tokenizers", reason="reads tokenizer.json")
helper, FLOAT, INT64, INT32 = onnx.helper, onnx.TensorProto.FLOAT, onnx.TensorProto.INT64, onnx.TensorProto.INT32

# A word's vector: which colour it speaks of. Row 0 is the padding, row 1 every unknown word.
WORDS = {"[PAD]": (9, 9, 9), "[UNK]": (0, 0, 0), "tomato": (1, 0, 0), "ketchup": (1, 0.2, 0), "lawn": (0, 1, 0)}
WORDS |= {"sea": (0, 0, 1), "ocean": (0, 0.2, 1)}
V, U = np.mgrid[:60, :120]


def _save(path, nodes, inputs, outputs, constants):
    graph = helper.make_graph(
        nodes,
        "tiny",
        [helper.make_tensor_value_info(n, kind, shape) for n, kind, shape in inputs],
        [helper.make_tensor_value_info(n, FLOAT, shape) for n, shape in outputs],
        [onnx.numpy_helper.from_array(np.asarray(v), n) for n, v in constants.items()],
    )
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8), str(path))
    return path


def _tokenizer(path):
    model = tokenizers.models.WordLevel({word: i for i, word in enumerate(WORDS)}, unk_token="[UNK]")
    tokenizer = tokenizers.Tokenizer(model)
    tokenizer.pre_tokenizer = tokenizers.pre_tokenizers.Whitespace()
    tokenizer.enable_padding(length=12)  # as sentence encoders' files ask for; must not blur the mean
    tokenizer.save(str(path))
    return path


def sentence_encoder(folder):
    """A "MiniLM": a vector for each token, [1, L, 3]."""
    nodes = [
        helper.make_node("Gather", ["table", "input_ids"], ["last_hidden_state"]),
        helper.make_node("ReduceSum", ["attention_mask"], ["unused"], keepdims=0),
    ]
    inputs = [(n, INT64, ["B", "L"]) for n in ("input_ids", "attention_mask")]
    table = {"table": np.array(list(WORDS.values()), np.float32)}
    network = _save(folder / "sentence.onnx", nodes, inputs, [("last_hidden_state", ["B", "L", 3])], table)
    return TextEncoder(network, _tokenizer(folder / "tokenizer.json"), threads=1)


def colour_classifier(path, size=16):
    """A "classifier" with the classes tomato, lawn, sea: the crop's mean red, green, blue, sharpened."""
    nodes = [
        helper.make_node("GlobalAveragePool", ["image"], ["mean"]),
        helper.make_node("Flatten", ["mean"], ["flat"]),
        helper.make_node("Mul", ["flat", "sharpness"], ["logits"]),
        helper.make_node("Softmax", ["logits"], ["probabilities"], axis=1),
    ]
    inputs = [("image", FLOAT, [1, 3, size, size])]
    return _save(path, nodes, inputs, [("probabilities", [1, 3])], {"sharpness": np.array(20, np.float32)})


def clip_pair(folder):
    """A "CLIP": the crop's mean colour, and the sum of the words' colours with the length fixed to 6 tokens (int32)."""
    nodes = [
        helper.make_node("GlobalAveragePool", ["pixel_values"], ["mean"]),
        helper.make_node("Flatten", ["mean"], ["image_embeds"]),
        helper.make_node("Identity", ["pixel_values"], ["last_hidden_state"]),
    ]
    inputs = [("pixel_values", FLOAT, ["B", 3, "H", "W"])]
    outputs = [("last_hidden_state", None), ("image_embeds", None)]
    image = _save(folder / "clip_image.onnx", nodes, inputs, outputs, {})
    table = np.array([(0, 0, 0), *list(WORDS.values())[1:]], np.float32)
    nodes = [
        helper.make_node("Gather", ["table", "input_ids"], ["each"]),
        helper.make_node("ReduceSum", ["each", "one"], ["text_embeds"], keepdims=0),
    ]
    inputs = [("input_ids", INT32, [1, 6])]
    constants = {"table": table, "one": np.array([1], np.int64)}
    text = _save(folder / "clip_text.onnx", nodes, inputs, [("text_embeds", [1, 3])], constants)
    return image, text, _tokenizer(folder / "clip_tokenizer.json")


def _disc(u, radius=12):
    return (U - u) ** 2 + (V - 30) ** 2 < radius**2


MASKS = np.stack([_disc(20), _disc(60), _disc(100)])
HAND = (np.abs(U - 38) < 4) & (np.abs(V - 30) < 8)  # touches the first disc, is near the second


def _image():
    image = np.full((60, 120, 3), 90, np.uint8)
    for mask, colour in zip(MASKS, ((200, 30, 20), (20, 190, 40), (20, 40, 210)), strict=True):
        image[mask] = colour
    image[HAND] = (20, 40, 230)
    return image


class Offers:
    """Proposes the three discs, and the hand."""

    promptable = False

    def candidates(self, image, prompts=None):
        return Candidates(np.concatenate([MASKS, HAND[None]]), np.full(4, 0.9, np.float32), np.full(4, -1))


@pytest.fixture(params=["conse", "clip"])
def chooser(request, tmp_path):
    if request.param == "clip":
        image, text, tokenizer = clip_pair(tmp_path)
        return ClipChooser(image, TextEncoder(text, tokenizer, threads=1), threads=1)
    classifier = colour_classifier(tmp_path / "classifier.onnx")
    return ConseChooser(classifier, ["tomato", "lawn", "sea"], sentence_encoder(tmp_path), top=2, threads=1)


@pytest.mark.parametrize("description, right", [("ketchup", 0), ("the lawn", 1), ("an ocean", 2)])
def test_the_crop_that_the_words_speak_of_wins(chooser, description, right):
    scores = chooser.scores(_image(), MASKS, description)
    assert scores.argmax() == right and scores[right] > np.delete(scores, right).max() + 3  # e^3 times as likely
    found = find_object(_image(), None, [Choice(HAND, "given")], Offers(), description=description, chooser=chooser)
    assert np.array_equal(found.mask, MASKS[right]) and description in found.how  # never the hand, blue as it is


def test_words_that_say_nothing_leave_it_to_the_hand(chooser):
    near = np.where(MASKS[0] | HAND, 8.0, 0.0)
    found = find_object(
        _image(), None, [Choice(HAND, "given")], Offers(), description="thing", chooser=chooser, motion=Motion.of(near)
    )
    assert np.array_equal(found.mask, MASKS[0])


def test_a_hint_overrides_the_words(chooser):
    hint = {"point": [60, 30]}
    found = find_object(_image(), hint, [Choice(HAND, "given")], Offers(), description="an ocean", chooser=chooser)
    assert np.array_equal(found.mask, MASKS[1]) and "hints.object" in found.how


def test_conse_is_the_mean_of_the_names_by_probability(tmp_path):
    """Norouzi et al., eq. 4, by hand: two likeliest of three classes."""
    classifier = colour_classifier(tmp_path / "classifier.onnx")
    conse = ConseChooser(classifier, ["tomato", "lawn", "sea"], sentence_encoder(tmp_path), top=2, threads=1)
    probabilities = conse.probabilities(_image(), MASKS[:1])[0]
    a, b = np.sort(probabilities)[::-1][:2]  # tomato, then lawn or sea
    assert conse.scores(_image(), MASKS[:1], "tomato")[0] == pytest.approx(a / np.hypot(a, b) / 0.1, abs=1e-5)


def test_crops_show_the_mask_and_nothing_else():
    image = _image()
    crops = masked_crops(image, np.stack([MASKS[0], np.zeros_like(HAND)]), 32)
    assert crops.shape == (2, 3, 32, 32) and crops.dtype == np.float32
    assert np.allclose(crops[0, :, 16, 16], np.array([200, 30, 20]) / 255, atol=1e-6)
    assert np.abs(crops[0][:, [0, 0, -1, -1], [0, -1, 0, -1]] - 0.5).max() < 0.01 and (crops[1] == 0.5).all()
    image[~MASKS[0]] = 255
    assert np.array_equal(masked_crops(image, MASKS[:1], 32)[0], crops[0])


def _video(description="an ocean", **more):
    return Video([_image()], None, np.eye(3), np.eye(4), description=description, **more)


def _networks_for(params, video, folder):
    return _networks.make_networks(params, video, folder)


def test_networks_that_are_not_fetched_are_named_with_their_command(tmp_path, monkeypatch):
    monkeypatch.setattr(_networks, "default_folder", lambda: tmp_path)
    params = SegmentAndTrack(segmenter="none", hand_finder="none", target="text")
    with pytest.raises(InputError, match=r"minilm.*missing.*`physreal models text`"):
        _networks_for(params, _video(), tmp_path)
    # Nothing is looked for where nobody would ask it: no description, a hint, a mask, or another rule.
    assert _networks_for(params, _video(""), tmp_path).chooser is None
    assert _networks_for(params, _video(hints={"object": {"point": [1, 1]}}), tmp_path).chooser is None
    assert _networks_for(params, _video(masks={"object": MASKS[:1]}), tmp_path).chooser is None
    assert _networks_for(SegmentAndTrack(segmenter="none", hand_finder="none"), _video(), tmp_path).chooser is None


def test_an_own_clip_comes_in_by_path(tmp_path, monkeypatch):
    (tmp_path / "params.yaml").touch()
    monkeypatch.chdir(tmp_path)
    folder = tmp_path / "data" / "models"
    folder.mkdir(parents=True)
    image, text, tokenizer = (str(path.relative_to(tmp_path)) for path in clip_pair(folder))
    own = {"segmenter": "none", "hand_finder": "none", "target": "clip", "threads": 1}
    params = SegmentAndTrack(**own)
    with pytest.raises(InputError, match="segment_and_track.clip_image_onnx"):
        _networks_for(params, _video(), tmp_path)
    keys = {"clip_image_onnx": image, "clip_text_onnx": text, "clip_tokenizer": tokenizer}
    found = _networks_for(SegmentAndTrack(**own, **keys), _video(), tmp_path).chooser
    assert found.scores(_image(), MASKS, "an ocean").argmax() == 2


def test_what_does_not_fit_together_is_said(tmp_path):
    image, text, tokenizer = clip_pair(tmp_path)
    with pytest.raises(InputError, match=r"the tokenizer is missing.*physreal models text"):
        TextEncoder(text, tmp_path / "none.json")
    (tmp_path / "broken.json").write_text("{}")
    with pytest.raises(InputError, match=r"broken\.json"):
        TextEncoder(text, tmp_path / "broken.json")
    with pytest.raises(InputError, match="input_ids"):
        TextEncoder(image, tokenizer)
    encoder = TextEncoder(text, tokenizer, threads=1)
    with pytest.raises(InputError, match="3 classes.*2 names"):
        conse = ConseChooser(colour_classifier(tmp_path / "c.onnx"), ["tomato", "lawn"], encoder, threads=1)
        conse.scores(_image(), MASKS, "sea")
    with pytest.raises(InputError, match="same network"):
        ClipChooser(_wide(tmp_path / "wide.onnx"), encoder, threads=1).scores(_image(), MASKS, "sea")


def _wide(path):
    """Images to vectors of 48 numbers, where the texts have 3."""
    return _save(
        path,
        [helper.make_node("Flatten", ["image"], ["embeds"])],
        [("image", FLOAT, [1, 3, 4, 4])],
        [("embeds", [1, 48])],
        {},
    )


@pytest.mark.slow
def test_the_real_networks_choose_among_photographs():
    """Six of scikit-image's photographs as round tiles of one image; each description chooses its own."""
    photographs = pytest.importorskip("skimage", reason="the photographs are scikit-image's")
    from pathlib import Path

    import cv2

    if any(any(check_files(n, default_folder()).values()) for n in ("minilm", "efficientnet", "imagenet_names")):
        pytest.skip("the networks are not there; `physreal models text` fetches them")
    folder = Path(photographs.__file__).parent / "data"
    names = ("chelsea.png", "coffee.png", "rocket.jpg", "motorcycle_left.png", "clock_motion.png", "astronaut.png")
    tiles = [_square(cv2.imread(str(folder / name))[..., ::-1]) for name in names]
    image = np.concatenate([np.concatenate(tiles[:3], 1), np.concatenate(tiles[3:], 1)], 0)
    v, u = np.mgrid[:400, :600]
    masks = np.stack([(u - 100 - 200 * (i % 3)) ** 2 + (v - 100 - 200 * (i // 3)) ** 2 < 95**2 for i in range(6)])
    params = SegmentAndTrack(segmenter="none", hand_finder="none", target="text", threads=1)
    video = replace(_video("a cat"), frames=[image])
    chooser = _networks_for(params, video, folder).chooser
    descriptions = ("a cat", "a cup of coffee", "a rocket", "a motorcycle", "a clock")  # people it does not know
    for right, description in enumerate(descriptions):
        assert chooser.scores(image, masks, description).argmax() == right, description


def _square(image):
    import cv2

    side = min(image.shape[:2])
    v, u = (np.array(image.shape[:2]) - side) // 2
    return cv2.resize(np.ascontiguousarray(image[v : v + side, u : u + side]), (200, 200), interpolation=cv2.INTER_AREA)
