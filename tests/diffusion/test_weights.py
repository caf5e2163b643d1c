import json

import pytest

pytest.importorskip("torch", reason="the diffusion controller needs torch")
pytest.importorskip("safetensors", reason="weights files need safetensors")

import torch
from safetensors.torch import save_file

from tests.diffusion.cases import TINY, history, model, plan
from tsc_missing.diffusion.weights import load_weights, save_weights
from tsc_missing.errors import UserError


@pytest.fixture
def path(tmp_path):
    save_weights(model(), tmp_path / "tiny.safetensors", {"seed": 3})
    return tmp_path / "tiny.safetensors"


def refusal(path):
    with pytest.raises(UserError) as error:
        load_weights(path)
    assert "\n" not in str(error.value)
    assert str(path) in str(error.value)
    return str(error.value)


def rewrite(path, **changes):
    made, manifest = load_weights(path)
    text = json.dumps({**manifest, **changes})
    save_file(made.state_dict(), path, metadata={"manifest": text})


def test_same_answer_after_saving_and_loading(path):
    made, manifest = load_weights(path)
    assert made.config == TINY
    assert manifest["seed"] == 3
    assert torch.equal(plan(made, history()).logits, plan(model(), history()).logits)
    assert [each.name for each in path.parent.iterdir()] == [path.name]


def test_a_file_that_is_not_there(path):
    assert "cannot be read" in refusal(path.with_name("other.safetensors"))


@pytest.mark.parametrize("kept", [0, 6, 200, -10])
def test_a_file_that_is_cut_off(path, kept):
    path.write_bytes(path.read_bytes()[:kept])
    assert "cut off" in refusal(path)


def test_a_manifest_that_is_none(path):
    made, _ = load_weights(path)
    save_file(made.state_dict(), path, metadata={"manifest": "[1]"})
    assert "not a weights file" in refusal(path)


def test_a_file_of_another_version(path):
    rewrite(path, version=99)
    assert "version 99" in refusal(path)


def test_a_file_with_a_flipped_bit(path):
    content = bytearray(path.read_bytes())
    content[-1] ^= 1
    path.write_bytes(content)
    assert "checksum" in refusal(path)


def test_a_config_with_an_unknown_key(path):
    rewrite(path, config={**TINY.model_dump(mode="json"), "widht": 8})
    assert "widht" in refusal(path)


def test_tensors_of_another_size(path):
    rewrite(path, config={**TINY.model_dump(mode="json"), "width": 32})
    assert "not those of its config" in refusal(path)


def test_a_place_that_cannot_be_written(path):
    with pytest.raises(UserError, match="cannot be written"):
        save_weights(model(), path / "below" / "file", {})
