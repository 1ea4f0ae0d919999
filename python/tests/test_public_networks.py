"""Networks and vocabularies of the public CATK code in this program, and the reverse.

Needs torch; some tests also need torch_cluster, torch_geometric, omegaconf and scipy, and the
folder of a checkout of github.com/NVlabs/catk in the environment variable `SMART_CHECKOUT`.
"""

from __future__ import annotations

import importlib.util
import json
import pickle
import sys
from pathlib import Path
from typing import Any, Callable, Dict, Tuple

import numpy as np
import pytest
from fakes import ROOT

torch = pytest.importorskip("torch")

SCRIPT = ROOT / "models" / "ntp" / "export.py"
SHIPPED = ROOT / "weights" / "smart" / "smart-small.safetensors"
MTR = ROOT / "weights" / "mtr.safetensors"

# The largest public size.
LARGEST: Dict[str, Any] = {
    "hidden_dim": 128,
    "num_freq_bands": 64,
    "num_heads": 8,
    "head_dim": 16,
    "dropout": 0.1,
    "hist_drop_prob": 0.1,
    "num_map_layers": 3,
    "num_agent_layers": 6,
    "pl2pl_radius": 10,
    "pl2a_radius": 30,
    "a2a_radius": 60,
    "time_span": 30,
    "num_historical_steps": 11,
    "num_future_steps": 80,
}
# A network whose settings are all unlike the public ones, with few tokens.
CUSTOM = {
    **LARGEST,
    "hidden_dim": 32,
    "num_freq_bands": 8,
    "num_heads": 2,
    "head_dim": 16,
    "dropout": 0.2,
    "hist_drop_prob": 0.05,
    "num_map_layers": 1,
    "num_agent_layers": 2,
    "pl2pl_radius": 9.0,
    "pl2a_radius": 25.0,
    "a2a_radius": 45.0,
    "time_span": 15,
}
TOKENS = 50


@pytest.fixture(scope="module")
def export() -> Any:
    """The script as a module."""
    spec = importlib.util.spec_from_file_location("export", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


Run = Callable[..., Tuple[int, str, str]]


@pytest.fixture
def run(export: Any, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Run:
    """Runs the script; returns its exit code, standard output and standard error."""

    def run(*arguments: Any) -> Tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["export.py", *map(str, arguments)])
        code, errors = 0, ""
        try:
            export.main()
        except SystemExit as stopped:
            is_text = isinstance(stopped.code, str)
            code, errors = (1, str(stopped.code)) if is_text else (int(stopped.code or 0), "")
        said = capsys.readouterr()
        return code, said.out, said.err + errors

    return run


def converted(run: Run, *arguments: Any) -> str:
    """Runs the script, which must succeed; returns its standard output."""
    code, out, errors = run(*arguments)
    assert (code, errors) == (0, "")
    return out


def refused(run: Run, *arguments: Any) -> str:
    """Runs the script, which must stop; returns its message."""
    code, out, errors = run(*arguments)
    assert (code, out) == (1, "")
    return errors


@pytest.fixture(scope="module")
def vocabularies(export: Any, tmp_path_factory: pytest.TempPathFactory) -> Tuple[Path, Path]:
    """Small vocabularies as pickles."""
    folder = tmp_path_factory.mktemp("vocabularies")
    time = np.linspace(0.0, 0.5, 6)
    speed, turn = np.linspace(0.0, 20.0, TOKENS), np.tile([-0.5, 0.0, 0.4, 0.9, -0.1], TOKENS // 5)
    poses = np.stack([np.outer(speed, time), np.outer(turn, time), np.outer(turn, time)], axis=-1)
    corners = {
        key: export.contours(poses * [1.0, 0.5, 1.0], *box).astype(np.float32)
        for key, (_, *box) in export.BOXES.items()
    }
    curves = np.zeros((20, 11, 2), np.float32)
    curves[..., 0] = np.linspace(0.0, 5.0, 11)
    curves[..., 1] = np.outer(np.linspace(-1.0, 1.0, 20), np.linspace(0.0, 1.0, 11) ** 2)
    files = (folder / "agents.pkl", folder / "map.pkl")
    for path, content in zip(files, ({"token_all": corners}, {"traj_src": curves})):
        path.write_bytes(pickle.dumps(content))
    return files


def make_network(checkout: Path, settings: Dict[str, Any], tokens: int) -> Any:
    """Returns a network of the checkout with random weights."""
    for package in ("torch_cluster", "torch_geometric", "omegaconf", "scipy"):
        pytest.importorskip(package)
    sys.path.insert(0, str(checkout))
    from src.smart.modules.smart_decoder import SMARTDecoder

    torch.manual_seed(0)
    return SMARTDecoder(**settings, n_token_agent=tokens)


def write_checkpoint(path: Path, network: Any, settings: Dict[str, Any]) -> Path:
    """Writes a checkpoint as a training of the checkout does."""
    import omegaconf

    names = {"agent_token_file": "agents.pkl", "map_token_file": "map.pkl"}
    config = omegaconf.OmegaConf.create({"decoder": settings, "token_processor": names})
    state = {f"encoder.{name}": tensor for name, tensor in network.state_dict().items()}
    torch.save({"state_dict": state, "hyper_parameters": {"model_config": config}}, path)
    return path


def test_vocabularies(export: Any, run: Run, vocabularies: Any, tmp_path: Path) -> None:
    both, folder = tmp_path / "both.safetensors", tmp_path / "catk"
    converted(run, "--vocabularies", *vocabularies, both)
    converted(run, "--to-catk", both, folder)
    assert sorted(path.name for path in folder.iterdir()) == ["agent_tokens.pkl", "map_tokens.pkl"]
    # Plain pickles, without this script.
    names = ("agent_tokens.pkl", "map_tokens.pkl")
    agents, curves = (pickle.loads((folder / name).read_bytes()) for name in names)
    before = [pickle.loads(path.read_bytes()) for path in vocabularies]
    assert set(agents["token_all"]) == {"veh", "ped", "cyc"}
    for key, corners in agents["token_all"].items():
        np.testing.assert_allclose(corners, before[0]["token_all"][key], atol=1e-5)
    assert np.array_equal(curves["traj_src"], before[1]["traj_src"])
    again = tmp_path / "again.safetensors"
    converted(run, "--vocabularies", *(folder / name for name in names), again)
    first, second = (export.read_safetensors(path) for path in (both, again))
    assert first[0] == second[0]
    for name, tensor in first[1].items():
        np.testing.assert_allclose(second[1][name], tensor, atol=1e-6)


def test_refusals(export: Any, run: Run, vocabularies: Tuple[Path, Path], tmp_path: Path) -> None:
    message = refused(run, "--to-catk", SHIPPED, tmp_path / "out")
    assert "`nearest_pl2a` is 32, in CATK 0" in message
    assert "every class has its own token head" in message
    assert "--recipe 7m" in message
    _, tensors = export.read_safetensors(SHIPPED)
    own = {name: tensor for name, tensor in tensors.items() if name.startswith("vocabulary.")}
    export.write(tmp_path / "tokens", own, {})
    message = refused(run, "--to-catk", tmp_path / "tokens", tmp_path / "out")
    assert "the classes have 768, 326 and 67 tokens" in message
    assert "--tokens 67" in message
    assert "the network is" in refused(run, "--to-catk", MTR, tmp_path / "out")
    assert "cannot be read as a safetensors file" in refused(
        run, "--to-catk", SCRIPT, tmp_path / "out"
    )
    assert not (tmp_path / "out").exists()
    message = refused(run, "--vocabularies", vocabularies[1], vocabularies[0], tmp_path / "out")
    assert "has no entry `token_all`" in message
    code, _, errors = run("--to-catk", SHIPPED, tmp_path / "out", "--heads", 4)
    assert code == 2
    assert "--heads belongs to the conversion of a checkpoint" in errors


def test_settings(run: Run, checkout: Path, vocabularies: Any, tmp_path: Path) -> None:
    network = make_network(checkout, CUSTOM, TOKENS)
    checkpoint = write_checkpoint(tmp_path / "last.ckpt", network, CUSTOM)
    files = (checkpoint, *vocabularies, tmp_path / "smart.safetensors")
    config = json.loads(converted(run, *files).splitlines()[0])
    horizon = ("num_historical_steps", "num_future_steps")
    expected = {name: value for name, value in CUSTOM.items() if name not in horizon}
    assert {name: config[name] for name in expected} == expected
    assert config["n_token_agent"] == TOKENS
    converted(run, *files, "--a2a", 45)  # the same value
    assert "--a2a is 60, but `a2a_radius` of the checkpoint's settings is 45" in refused(
        run, *files, "--a2a", 60
    )

    write_checkpoint(checkpoint, network, {**CUSTOM, "hidden_dim": 64})
    assert "`hidden_dim` of the checkpoint's settings is 64, but its tensors have 32" in refused(
        run, *files
    )
    write_checkpoint(checkpoint, network, {**CUSTOM, "time_span": None, "k_ego_gmm": 16})
    code, out, errors = run(*files)
    assert code == 0
    assert json.loads(out.splitlines()[0])["time_span"] == 11
    assert "no settings k_ego_gmm" in errors
    renamed = tmp_path / "other.pkl"
    renamed.write_bytes(vocabularies[0].read_bytes())
    write_checkpoint(checkpoint, network, CUSTOM)
    assert (
        "`agent_token_file` of the checkpoint's settings is agents.pkl, you give other.pkl"
        in (run(checkpoint, renamed, *files[2:])[2])
    )

    # Without settings.
    torch.save(network.state_dict(), checkpoint)
    assert "give --pl2pl: no published network" in refused(run, *files, "--heads", 2)
    reach = ("--pl2pl", 9, "--pl2a", 25, "--a2a", 45, "--time-span", 15)
    code, _, errors = run(*files, *reach)
    assert code == 0
    assert "the checkpoint does not state num_heads 4: assumed" in errors


def test_network_to_catk(run: Run, checkout: Path, vocabularies: Any, tmp_path: Path) -> None:
    network = make_network(checkout, CUSTOM, TOKENS)
    checkpoint = write_checkpoint(tmp_path / "last.ckpt", network, CUSTOM)
    weights, folder = tmp_path / "smart.safetensors", tmp_path / "catk"
    converted(run, checkpoint, *vocabularies, weights)
    converted(run, "--to-catk", weights, folder)
    stored = torch.load(folder / "network.ckpt", weights_only=True)
    settings = stored["hyper_parameters"]["model_config"]["decoder"]
    assert settings == CUSTOM
    state = {name[len("encoder.") :]: own for name, own in stored["state_dict"].items()}
    loaded = make_network(checkout, settings, TOKENS)
    loaded.load_state_dict(state, strict=True)
    for name, tensor in network.state_dict().items():
        assert torch.equal(loaded.state_dict()[name], tensor), name
