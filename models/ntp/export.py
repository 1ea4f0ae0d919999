#!/usr/bin/env python3
"""Converts networks and vocabularies between the public code of CATK and reactsim.

    python3 export.py CHECKPOINT AGENT_VOCABULARY MAP_VOCABULARY OUTPUT [options]
    python3 export.py --vocabularies AGENT_VOCABULARY MAP_VOCABULARY OUTPUT
    python3 export.py --to-catk FILE [FILE ...] FOLDER

CHECKPOINT        a PyTorch or Lightning checkpoint of SMART's network, as CATK and TrajTok train
                  it: a dict with `state_dict`, or a state dict itself; any prefix of the names
AGENT_VOCABULARY  the pickle with `token_all` {veh, ped, cyc}: corners [tokens, 6, 4, 2] (such as
                  agent_vocab_555_s2.pkl)
MAP_VOCABULARY    the pickle with `traj_src` [curves, 11, 2] (map_traj_token5.pkl)
OUTPUT            the safetensors file: weights for reactsim run --models smart --model-weights
                  smart=OUTPUT, or both vocabularies for reactsim train smart --input
                  vocabulary=OUTPUT --input map-vocabulary=OUTPUT
FILE              weights of `smart`, or vocabularies of reactsim train vocabulary
FOLDER            receives what the files contain: network.ckpt, agent_tokens.pkl, map_tokens.pkl

Needs torch and numpy. Nothing in the files is executed: of pickles, only containers, numbers,
texts, arrays and tensors are read.

Widths and numbers of layers follow from the tensors. Radii, time span, number of heads and dropout
are read from the settings in the checkpoint (`hyper_parameters.model_config`). If a checkpoint has
no settings, they are the options, or else the values of the published networks of that width (128:
7M and 3M, 64: 1M); a warning lists the values that were assumed.
"""

import argparse
import json
import pickle
import re
import struct
import sys
from pathlib import Path

import numpy as np
import torch

# Length and width of the box of each class, metres (CATK); tokens are stored as its corners.
BOXES = {
    "veh": ("vehicle", 4.8, 2.0),
    "ped": ("pedestrian", 1.0, 1.0),
    "cyc": ("cyclist", 2.0, 1.0),
}
# Settings that are not in the tensors, with the option that gives them and the values by the width
# of the features: radii in metres, time span in frames.
REACHES = {
    "pl2pl_radius": ("--pl2pl", {128: 10.0, 64: 10.0}),
    "pl2a_radius": ("--pl2a", {128: 30.0, 64: 20.0}),
    "a2a_radius": ("--a2a", {128: 60.0, 64: 20.0}),
    "time_span": ("--time-span", {128: 30, 64: 20}),
}
# Heads by their joint width: 8 of 16, 4 of 8.
HEADS = {128: 8, 32: 4}
# Rates that only training uses, as published.
RATES = {"dropout": 0.1, "hist_drop_prob": 0.1}
# Frames before the first planned one, and planned frames, in the public configurations.
HORIZON = {"num_historical_steps": 11, "num_future_steps": 80}
# Settings that networks of reactsim can have, and CATK's code has only with these values.
FIXED = {
    "nearest_pl2pl": 0,
    "nearest_pl2a": 0,
    "nearest_a2a": 0,
    "feed_forward": "relu",
    "ffn_multiple": 4,
    "mlp_embedding_first_width": 128,
    "shift_frames": 5,
    "max_neighbours_pl2pl": 100,
    "max_neighbours_a2a": 300,
    "max_agents_per_map_token_pl2a": 300,
    "map_point_types": 10,
    "map_polygon_types": 4,
    "map_light_types": 5,
    "agent_types": 3,
    "layer_norm_eps": 1e-5,
}
# Metadata keys of the provenance of both vocabularies, and tensors of the vocabularies.
PROVENANCE = ("reactsim.vocabulary", "reactsim.map_vocabulary")
CURVES = "map_vocabulary.curves"


class Inert:
    """Replaces an object that is neither a tensor nor an array: its class is not imported."""

    state: object = None

    def __new__(cls, *_args, **_kwargs):
        return super().__new__(cls)

    def __init__(self, *_args, **_kwargs):
        pass

    def __setstate__(self, state):
        self.state = state

    def __setitem__(self, _key, _value):
        pass

    def append(self, _value):
        pass

    def extend(self, _values):
        pass


def plain(value):
    """Returns settings as containers and values, also of the nodes of omegaconf."""
    if isinstance(value, Inert):
        node = value.state if isinstance(value.state, dict) else {}
        return plain(node.get("_content", node.get("_val")))
    if isinstance(value, dict):
        return {plain(name): plain(inner) for name, inner in value.items()}
    return [plain(inner) for inner in value] if isinstance(value, (list, tuple)) else value


class Arrays(pickle.Unpickler):
    """Reads pickles of containers and numpy arrays, and refuses everything else."""

    ALLOWED = re.compile(
        r"numpy\.(ndarray|dtype)|numpy\.(_?core)\.multiarray\.(_reconstruct|scalar)|numpy\._core\.numeric\._frombuffer"
        r"|numpy\.core\.numeric\._frombuffer|collections\.OrderedDict|_codecs\.encode"
    )

    def find_class(self, module, name):
        if not self.ALLOWED.fullmatch(f"{module}.{name}"):
            raise pickle.UnpicklingError(
                f"it wants `{module}.{name}`, which is neither an array nor a container"
            )
        return super().find_class(module, name)


class Checkpoint(Arrays):
    """Reads checkpoints: tensors and arrays; everything else is inert."""

    TENSORS = re.compile(
        r"torch\._utils\._rebuild_(tensor(_v2)?|parameter)|torch\.(Size|device|\w+Storage|float\d+|bfloat16|int\d+|uint8|bool)"
        r"|torch\.storage\.(UntypedStorage|TypedStorage)|torch\.Tensor|torch\.nn\.parameter\.Parameter"
    )

    def find_class(self, module, name):
        whole = f"{module}.{name}"
        if self.TENSORS.fullmatch(whole) or self.ALLOWED.fullmatch(whole):
            return pickle.Unpickler.find_class(self, module, name)
        return Inert


class Pickling:
    """What torch.load takes for the pickle module."""

    __name__ = "pickle"
    Unpickler = Checkpoint

    @staticmethod
    def load(file, **kwargs):
        return Checkpoint(file, **kwargs).load()


def stop(text):
    sys.exit(f"export.py: {text}")


def warn(text):
    print(f"export.py: warning: {text}", file=sys.stderr)


def section(settings, name):
    """Returns an inner dict of settings, empty if it is missing."""
    inner = settings.get(name) if isinstance(settings, dict) else None
    return inner if isinstance(inner, dict) else {}


def read_checkpoint(path):
    """Returns the state dict in a file, and the settings of its model, empty if it has none."""
    try:
        try:
            found = torch.load(path, map_location="cpu", weights_only=True)
        except pickle.UnpicklingError:
            found = torch.load(path, map_location="cpu", weights_only=False, pickle_module=Pickling)
    except (pickle.UnpicklingError, RuntimeError, EOFError, OSError) as error:
        stop(f"{path} cannot be read as a checkpoint: {error}")
    state = found.get("state_dict", found) if isinstance(found, dict) else None
    if not state or not any(isinstance(value, torch.Tensor) for value in state.values()):
        stop(f"{path} holds no state dict: expected a dict of tensors, or one under `state_dict`")
    settings = section(section(plain(found), "hyper_parameters"), "model_config")
    tensors = {name: value for name, value in state.items() if isinstance(value, torch.Tensor)}
    return tensors, settings


def read_pickle(path, key):
    try:
        with open(path, "rb") as file:
            found = Arrays(file).load()
    except (pickle.UnpicklingError, EOFError, OSError) as error:
        stop(f"{path} cannot be read as a pickle: {error}")
    if not isinstance(found, dict) or key not in found:
        stop(f"{path} has no entry `{key}`")
    return found[key]


def contours(poses, length, width):
    """Returns the corners [..., 4, 2] of a box at poses [..., 3] (x, y, heading).

    They are left front, right front, right back, left back.
    """
    x, y, heading = np.moveaxis(np.asarray(poses, dtype=np.float64), -1, 0)
    centre = np.stack([x, y], -1)[..., None, :]
    ahead = np.stack([np.cos(heading), np.sin(heading)], -1)[..., None, :] * length / 2
    left = np.stack([-np.sin(heading), np.cos(heading)], -1)[..., None, :] * width / 2
    sides = [ahead + left, ahead - left, -ahead - left, -ahead + left]
    return centre + np.concatenate(sides, axis=-2)


def agent_vocabulary(path):
    """Returns tokens [tokens, 6, 3] (x, y, heading) per class, from corners."""
    found, poses = read_pickle(path, "token_all"), {}
    for key, (name, length, width) in BOXES.items():
        if not isinstance(found, dict) or key not in found:
            stop(f"{path}: `token_all` has no entry `{key}`")
        corners = np.asarray(found[key], dtype=np.float64)
        if corners.ndim != 4 or corners.shape[1:] != (6, 4, 2):
            stop(
                f"{path}: `token_all` of `{key}` is {list(corners.shape)}, expected "
                "[tokens, 6, 4, 2]: tokens of 0.5 s at 10 Hz"
            )
        along = corners[:, :, 0] - corners[:, :, 3]
        heading = np.arctan2(along[..., 1], along[..., 0])
        own = np.concatenate([corners.mean(axis=2), heading[..., None]], axis=-1)
        # reactsim takes the corners from the poses: they must come out as they were.
        gap = np.abs(contours(own, length, width) - corners)[:, -1].max()
        if not gap < 0.01:
            stop(
                f"{path}: corners of `{key}` are up to {gap:.3f} m off a box of {length} by "
                f"{width} m, expected 0.01 m"
            )
        poses[name] = own.astype(np.float32)
    return poses


def map_vocabulary(path):
    """Returns curves [curves, 11, 2]."""
    curves = np.asarray(read_pickle(path, "traj_src"), dtype=np.float32)
    if curves.ndim != 3 or curves.shape[1:] != (11, 2):
        stop(f"{path}: `traj_src` is {list(curves.shape)}, expected [curves, 11, 2]")
    return curves


def network(state):
    """Returns the tensors of the network, named as in reactsim, and the names of the others."""
    mark = "map_encoder.type_pt_emb.weight"
    prefixes = [name[: -len(mark)] for name in state if name.endswith(mark)]
    if len(prefixes) != 1:
        stop(
            f"{len(prefixes)} tensors are called ...{mark}, expected 1; there are "
            f"{', '.join(list(state)[:5])} ..."
        )
    inside = re.compile(re.escape(prefixes[0]) + r"((map|agent)_encoder\..*)")
    own = {m[1]: value for name, value in state.items() if (m := inside.fullmatch(name))}
    return own, [name for name in state if not inside.fullmatch(name)]


def rows(own, name, dimension=0):
    if name not in own:
        stop(f"the checkpoint has no tensor `{name}`")
    return own[name].shape[dimension]


def setting(settings, name, default):
    """Returns a number of the settings of a checkpoint, or the default."""
    value = settings.get(name, default)
    if isinstance(value, bool) or not isinstance(value, (int, float, type(default))):
        stop(f"`{name}` of the checkpoint's settings is {value!r}, expected a number")
    return value


def choose(settings, options, name, option, default):
    """Returns a setting of the checkpoint, else the option, else the default.

    The second value tells whether it is the default.
    """
    given = getattr(options, option[2:].replace("-", "_"))
    stated = setting(settings, name, None)
    if name == "time_span" and name in settings and stated is None:
        # The public code then takes the length of the history.
        stated = setting(settings, "num_historical_steps", HORIZON["num_historical_steps"])
    if stated is None:
        if given is None and default is None:
            stop(f"give {option}: no published network has this width")
        return (default, True) if given is None else (given, False)
    if given is not None and given != stated:
        stop(
            f"{option} is {given:g}, but `{name}` of the checkpoint's settings is {stated:g}: "
            f"omit {option}"
        )
    return stated, False


def configuration(own, vocabulary, curves, settings, options):
    """Returns the configuration of the network, under the names of the published ones."""

    def layers(kind):
        return len({name.split(".")[2] for name in own if name.startswith(kind)})

    for name, expected_rows in [
        ("map_encoder.type_pt_emb", 10),
        ("map_encoder.light_pl_emb", 5),
        ("agent_encoder.type_a_emb", 3),
    ]:
        if (found := rows(own, f"{name}.weight")) != expected_rows:
            stop(
                f"`{name}` has {found} rows, expected {expected_rows} as in CATK and TrajTok: "
                "the checkpoint uses other codes"
            )
    measured = {
        "hidden_dim": own["map_encoder.type_pt_emb.weight"].shape[1],
        "num_freq_bands": rows(own, "map_encoder.r_pt2pt_emb.freqs.weight", 1),
        "num_map_layers": layers("map_encoder.pt2pt_layers."),
        "num_agent_layers": layers("agent_encoder.t_attn_layers."),
    }
    attended = rows(own, "agent_encoder.t_attn_layers.0.to_q.weight")
    heads, is_assumed = choose(settings, options, "num_heads", "--heads", HEADS.get(attended))
    assumed = {"num_heads": heads} if is_assumed else {}
    if heads < 1 or attended % heads:
        stop(f"{heads} heads cannot be {attended} wide together: `to_q` has {attended} rows")
    measured["head_dim"] = attended // heads
    for name, found in measured.items():
        if (stated := setting(settings, name, found)) != found:
            stop(
                f"`{name}` of the checkpoint's settings is {stated}, but its tensors have {found}: "
                "the settings belong to another network"
            )
    reach = {}
    for name, (option, by_width) in REACHES.items():
        default = by_width.get(measured["hidden_dim"])
        reach[name], is_assumed = choose(settings, options, name, option, default)
        assumed |= {name: reach[name]} if is_assumed else {}
    if assumed:
        listed = ", ".join(f"{name} {value:g}" for name, value in assumed.items())
        warn(
            f"the checkpoint does not state {listed}: assumed as in the published networks; if it "
            "was trained with other values, give them (--help)"
        )
    known = {*measured, *reach, *RATES, *HORIZON, "num_heads"}
    if unknown := sorted(set(settings) - known):
        warn(f"the network of SMART has no settings {', '.join(unknown)}: left out")
    head = "agent_encoder.token_predict_head"
    if f"{head}.mlp.3.weight" in own:
        counts = rows(own, f"{head}.mlp.3.weight")
        by_class = dict.fromkeys(BOXES, counts)
    else:
        counts = by_class = {key: rows(own, f"{head}.{key}.mlp.3.weight") for key in BOXES}
    for key, (name, _, _) in BOXES.items():
        if len(vocabulary[name]) != by_class[key]:
            stop(
                f"the vocabulary has {len(vocabulary[name])} tokens of `{key}`, the network "
                f"scores {by_class[key]}"
            )
    is_relu = "agent_encoder.t_attn_layers.0.ff_mlp.0.weight" in own
    return {
        **measured,
        "num_heads": heads,
        **{name: setting(settings, name, rate) for name, rate in RATES.items()},
        **reach,
        "n_token_agent": counts,
        "n_token_map": len(curves),
        "mlp_embedding_first_width": rows(own, "map_encoder.token_emb.mlp.0.weight"),
        "feed_forward": "relu" if is_relu else "swiglu",
    }


def expected(config):
    """Returns the names of all tensors of a network."""

    def both(*names):
        return [f"{name}.{part}" for name in names for part in ("weight", "bias")]

    def mlp(name, *places):
        return both(*(f"{name}.mlp.{place}" for place in places))

    def fourier(name, scalars):
        inner = [f"{name}.mlps.{d}.{place}" for d in range(scalars) for place in (0, 1, 3)]
        return [f"{name}.freqs.weight", *both(*inner, f"{name}.to_out.0", f"{name}.to_out.2")]

    def attention(name, count):
        is_relu = config["feed_forward"] == "relu"
        feed = ["ff_mlp.0", "ff_mlp.3"] if is_relu else ["ff_mlp.w12", "ff_mlp.w3"]
        norms = ["x_src", "x_dst", "r"]
        parts = [*(f"attn_prenorm_{norm}" for norm in norms), "attn_postnorm", "ff_prenorm"]
        parts += ["ff_postnorm", "to_q", "to_v", "to_v_r", "to_s", "to_g", "to_out", *feed]
        for i in range(count):
            yield from both(*(f"{name}.{i}.{part}" for part in parts))
            yield from (f"{name}.{i}.{part}.weight" for part in ("to_k", "to_k_r"))

    tables = ("type_pt_emb", "polygon_type_emb", "light_pl_emb")
    names = [f"map_encoder.{table}.weight" for table in tables]
    names += mlp("map_encoder.token_emb", 0, 1, 3, 4, 6) + fourier("map_encoder.r_pt2pt_emb", 3)
    names += attention("map_encoder.pt2pt_layers", config["num_map_layers"])
    names += ["agent_encoder.type_a_emb.weight", *mlp("agent_encoder.shape_emb", 0, 1, 3)]
    for key in BOXES:
        names += mlp(f"agent_encoder.token_emb_{key}", 0, 1, 3, 4, 6)
    names += mlp("agent_encoder.fusion_emb", 0, 1, 3, 4, 6)
    for name, scalars in [("x_a_emb", 2), ("r_t_emb", 4), ("r_pt2a_emb", 3), ("r_a2a_emb", 3)]:
        names += fourier(f"agent_encoder.{name}", scalars)
    for name in ("t_attn_layers", "pt2a_attn_layers", "a2a_attn_layers"):
        names += attention(f"agent_encoder.{name}", config["num_agent_layers"])
    heads = [""] if isinstance(config["n_token_agent"], int) else [f".{key}" for key in BOXES]
    for key in heads:
        names += mlp(f"agent_encoder.token_predict_head{key}", 0, 1, 3)
    return set(names)


def write(path, tensors, metadata):
    """A safetensors file; the same tensors give the same bytes."""
    header, end = {"__metadata__": metadata}, 0
    for name, array in sorted(tensors.items()):
        start, end = end, end + array.nbytes
        header[name] = {"dtype": "F32", "shape": list(array.shape), "data_offsets": [start, end]}
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 8)
    with open(path, "wb") as file:
        file.write(struct.pack("<Q", len(text)) + text)
        for _, array in sorted(tensors.items()):
            file.write(np.ascontiguousarray(array, dtype="<f4").tobytes())


def check_vocabulary_names(settings, agent_file, map_file):
    """Warns if the checkpoint was trained with vocabularies of other names."""
    names = section(settings, "token_processor")
    for name, given in [("agent_token_file", agent_file), ("map_token_file", map_file)]:
        stated = names.get(name)
        if isinstance(stated, str) and Path(stated).name != Path(given).name:
            warn(
                f"`{name}` of the checkpoint's settings is {Path(stated).name}, you give "
                f"{Path(given).name}: with other tokens the network is useless"
            )


def to_reactsim(checkpoint, agent_file, map_file, output, options):
    """Writes the weights of a checkpoint with its vocabularies, or only the vocabularies."""
    vocabulary, curves = agent_vocabulary(agent_file), map_vocabulary(map_file)
    made = {"method": "foreign", "settings": None, "seed": 0, "scenarios": 0, "data": ""}
    metadata = dict.fromkeys(PROVENANCE, json.dumps(made))
    tensors, others = {}, []
    if checkpoint is not None:
        state, settings = read_checkpoint(checkpoint)
        check_vocabulary_names(settings, agent_file, map_file)
        own, others = network(state)
        config = configuration(own, vocabulary, curves, section(settings, "decoder"), options)
        names = expected(config)
        if missing := sorted(names - own.keys()):
            stop(f"the checkpoint lacks {len(missing)} tensors: {', '.join(missing[:8])}")
        others += sorted(own.keys() - names)
        tensors = {n: own[n].detach().float().contiguous().numpy() for n in sorted(names)}
        for name, array in tensors.items():
            if not np.isfinite(array).all():
                stop(f"tensor `{name}` holds values that are not finite")
        metadata["config"] = json.dumps({"kind": "smart", "network": config})
        print(json.dumps(config))
    tensors |= {f"vocabulary.{name}": poses for name, poses in vocabulary.items()}
    tensors[CURVES] = curves
    write(output, tensors, metadata)
    print(f"{output}: {len(tensors)} tensors; {len(others)} left out")
    for name in others:
        print(f"  left out: {name}")


# --------------------------------------------------------------------------------------------------
# To CATK.


def read_safetensors(path):
    """Returns the metadata and the 32-bit tensors of a file of reactsim."""
    try:
        data = Path(path).read_bytes()
        end = 8 + struct.unpack("<Q", data[:8])[0]
        header = json.loads(data[8:end])
        metadata, tensors = header.pop("__metadata__", {}), {}
        for name, entry in header.items():
            first, last = entry["data_offsets"]
            array = np.frombuffer(data[end + first : end + last], "<f4").reshape(entry["shape"])
            tensors[name] = (
                array if entry["dtype"] == "F32" else stop(f"{path}: `{name}` is no 32-bit tensor")
            )
    except (OSError, struct.error, ValueError, KeyError, TypeError, AttributeError) as error:
        stop(f"{path} cannot be read as a safetensors file: {error}")
    return metadata, tensors


class PortablePickler(pickle.Pickler):
    """Writes arrays in a form that every version of numpy reads.

    The functions of numpy to which its own pickles refer have other names in older versions.
    """

    def reducer_override(self, value):
        if isinstance(value, np.ndarray):
            return np.ndarray, (value.shape, "<f4", value.astype("<f4").tobytes())
        return NotImplemented


def write_pickle(path, content):
    with open(path, "wb") as file:
        PortablePickler(file, protocol=4).dump(content)


def check_network(path, config):
    """Stops unless CATK's code has this network."""
    differences = [
        f"`{name}` is {config[name]}, in CATK {value}"
        for name, value in FIXED.items()
        if config.get(name, value) != value
    ]
    if isinstance(config["n_token_agent"], dict):
        differences.append("every class has its own token head, in CATK there is one for all")
    if differences:
        stop(
            f"{path}: CATK's code cannot run this network: {'; '.join(differences)}. "
            "`reactsim train smart --recipe 7m` trains one that it can run"
        )


def to_catk(files, folder):
    """Writes the networks and vocabularies of files as the public code reads them."""
    metadata, tensors, origin = {}, {}, {}
    for path in files:
        stated, own = read_safetensors(path)
        for name in own:
            if name in origin:
                stop(f"{path} and {origin[name]} both hold `{name}`: give one of them")
        metadata |= stated
        tensors |= own
        origin |= dict.fromkeys(own, path)
    sources = ", ".join(files)
    config = None
    if "config" in metadata:
        stored = json.loads(metadata["config"])
        if stored.get("kind") != "smart":
            stop(f"{sources}: the network is `{stored.get('kind')}`, expected `smart`")
        config = stored["network"]
        check_network(sources, config)
    written = {}
    poses = {key: tensors.pop(f"vocabulary.{name}", None) for key, (name, _, _) in BOXES.items()}
    if any(own is not None for own in poses.values()):
        missing = [f"vocabulary.{BOXES[key][0]}" for key, own in poses.items() if own is None]
        if missing:
            stop(f"{sources}: no tensor `{missing[0]}`")
        counts = [len(own) for own in poses.values()]
        if len(set(counts)) > 1:
            stop(
                f"the classes have {counts[0]}, {counts[1]} and {counts[2]} tokens; CATK's code "
                "needs the same number for all: `reactsim train vocabulary --method k-disks "
                f"--tokens {min(counts)}` without --fill makes such a vocabulary"
            )
        corners = {key: contours(own, *BOXES[key][1:]) for key, own in poses.items()}
        written["agent_tokens.pkl"] = {"token_all": corners}
    if (curves := tensors.pop(CURVES, None)) is not None:
        written["map_tokens.pkl"] = {"traj_src": curves}
    if config is not None and len(written) < 2:
        stop(f"{sources}: the network comes without its vocabularies")
    if not written:
        stop(f"{sources}: neither a network nor a vocabulary of reactsim")
    checkpoint = None if config is None else lightning_checkpoint(config, tensors)
    Path(folder).mkdir(parents=True, exist_ok=True)
    for name, content in written.items():
        write_pickle(Path(folder) / name, content)
        print(Path(folder) / name)
    if checkpoint is not None:
        torch.save(checkpoint, Path(folder) / "network.ckpt")
        print(Path(folder) / "network.ckpt")
        print("settings for the public code, under model.model_config.decoder:")
        print(json.dumps(checkpoint["hyper_parameters"]["model_config"]["decoder"]))


def lightning_checkpoint(config, tensors):
    """Returns the checkpoint of a network as Lightning stores it."""
    state = {}
    for name in sorted(expected(config)):
        # Where sources and destinations are of one kind, they share a norm, which has two names.
        is_shared = "pt2a_attn_layers" not in name
        twin = name.replace("attn_prenorm_x_dst", "attn_prenorm_x_src") if is_shared else name
        if (array := tensors.get(name, tensors.get(twin))) is None:
            stop(f"the file has no tensor `{name}`")
        state[f"encoder.{name}"] = torch.tensor(array)
    names = ["hidden_dim", "num_freq_bands", "num_heads", "head_dim", "num_map_layers"]
    names += ["num_agent_layers", *REACHES, "dropout"]
    sampling = {"num_k": 1, "temp": 1.0}
    settings = {
        "decoder": {
            **{name: config[name] for name in names},
            "hist_drop_prob": config.get("hist_drop_prob", RATES["hist_drop_prob"]),
            **HORIZON,
        },
        "token_processor": {
            "agent_token_file": "agent_tokens.pkl",
            "map_token_file": "map_tokens.pkl",
            "agent_token_sampling": sampling,
            "map_token_sampling": dict(sampling),
        },
    }
    return {
        "state_dict": state,
        "hyper_parameters": {"model_config": settings},
        # Lightning refuses checkpoints without these.
        "pytorch-lightning_version": "2.4.0",
        "epoch": 0,
        "global_step": 0,
    }


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("files", nargs="+", metavar="FILE", help="as above")
    kind = parser.add_mutually_exclusive_group()
    kind.add_argument("--vocabularies", action="store_true", help="vocabularies without a network")
    kind.add_argument("--to-catk", action="store_true", help="from reactsim to the public code")
    add = parser.add_argument
    add("--pl2pl", type=float, help="radius around map pieces for other map pieces, m (10)")
    add("--pl2a", type=float, help="radius around agents for map pieces, m (30; 1M: 20)")
    add("--a2a", type=float, help="radius around agents for agents, m (60; 1M: 20)")
    add("--time-span", type=int, help="time over which agents see themselves, frames (30; 1M: 20)")
    add("--heads", type=int, help="attention heads (8 if 128 wide together, 4 if 32)")
    options = parser.parse_args()
    files = options.files
    given = [option for _, (option, _) in REACHES.items()] + ["--heads"]
    given = [o for o in given if getattr(options, o[2:].replace("-", "_")) is not None]
    if (options.to_catk or options.vocabularies) and given:
        parser.error(f"{given[0]} belongs to the conversion of a checkpoint to reactsim")
    if options.to_catk:
        if len(files) < 2:
            parser.error("--to-catk needs at least one FILE, and a FOLDER")
        to_catk(files[:-1], files[-1])
    elif options.vocabularies:
        if len(files) != 3:
            parser.error("--vocabularies needs AGENT_VOCABULARY, MAP_VOCABULARY and OUTPUT")
        to_reactsim(None, *files, options)
    else:
        if len(files) != 4:
            parser.error("give CHECKPOINT, AGENT_VOCABULARY, MAP_VOCABULARY and OUTPUT")
        to_reactsim(*files, options)


if __name__ == "__main__":
    main()
