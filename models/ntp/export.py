#!/usr/bin/env python3
"""Turns a checkpoint of SMART's network, as CATK and TrajTok train it, into a file that reactsim reads.

    python3 export.py CHECKPOINT AGENT_VOCABULARY MAP_VOCABULARY OUTPUT [options]

CHECKPOINT        a PyTorch or Lightning checkpoint: a dict with `state_dict`, or a state dict itself; any prefix of the names
AGENT_VOCABULARY  the pickle with `token_all` {veh, ped, cyc}: corners [tokens, 6, 4, 2] (such as agent_vocab_555_s2.pkl)
MAP_VOCABULARY    the pickle with `traj_src` [curves, 11, 2] (map_traj_token5.pkl)
OUTPUT            the safetensors file; reactsim run --models smart --model-weights smart=OUTPUT

Needs torch and numpy. Nothing in the three files is executed: pickles may hold arrays and tensors, and what
else a checkpoint holds (settings, optimisers) is passed over unread.

Widths and numbers of layers are those of the tensors. Radii, the time span and the number of heads do not stand in
tensors: without options they are those of the published networks of that width (128: 7M and 3M, 64: 1M).
"""

import argparse
import json
import pickle
import re
import struct
import sys

import numpy as np
import torch

# Length and width of the boxes that stand for the classes, metres (CATK): the corners of tokens are theirs.
BOXES = {"veh": ("vehicle", 4.8, 2.0), "ped": ("pedestrian", 1.0, 1.0), "cyc": ("cyclist", 2.0, 1.0)}
# Radii (m) and time span (frames) by the width of the features.
REACHES = {128: (10.0, 30.0, 60.0, 30), 64: (10.0, 20.0, 20.0, 20)}
# Heads by their joint width: 8 of 16, 4 of 8.
HEADS = {128: 8, 32: 4}


class Inert:
    """Stands for what a checkpoint holds beside tensors. Does nothing."""

    def __new__(cls, *_args, **_kwargs):
        return super().__new__(cls)

    def __init__(self, *_args, **_kwargs):
        pass

    def __setstate__(self, _state):
        pass

    def __setitem__(self, _key, _value):
        pass

    def append(self, _value):
        pass

    def extend(self, _values):
        pass


class Arrays(pickle.Unpickler):
    """Reads pickles of containers and numpy arrays, and refuses everything else."""

    ALLOWED = re.compile(
        r"numpy\.(ndarray|dtype)|numpy\.(_?core)\.multiarray\.(_reconstruct|scalar)|numpy\._core\.numeric\._frombuffer"
        r"|numpy\.core\.numeric\._frombuffer|collections\.OrderedDict|_codecs\.encode"
    )

    def find_class(self, module, name):
        if not self.ALLOWED.fullmatch(f"{module}.{name}"):
            raise pickle.UnpicklingError(f"it wants `{module}.{name}`, which is neither an array nor a container")
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


def read_checkpoint(path):
    """The state dict in a file."""
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
    return {name: value for name, value in state.items() if isinstance(value, torch.Tensor)}


def read_pickle(path, key):
    try:
        with open(path, "rb") as file:
            found = Arrays(file).load()
    except (pickle.UnpicklingError, EOFError, OSError) as error:
        stop(f"{path} cannot be read as a pickle: {error}")
    if not isinstance(found, dict) or key not in found:
        stop(f"{path} has no entry `{key}`")
    return found[key]


def agent_vocabulary(path):
    """Tokens [tokens, 6, 3] (x, y, heading) per class, from corners."""
    contours, poses = read_pickle(path, "token_all"), {}
    for key, (name, length, width) in BOXES.items():
        corners = np.asarray(contours[key], dtype=np.float64)
        if corners.ndim != 4 or corners.shape[1:] != (6, 4, 2):
            stop(f"{path}: `token_all` of `{key}` is {list(corners.shape)}, expected [tokens, 6, 4, 2]: tokens of 0.5 s at 10 Hz")
        centre = corners.mean(axis=2)
        along = corners[:, :, 0] - corners[:, :, 3]
        heading = np.arctan2(along[..., 1], along[..., 0])
        # reactsim takes the corners from the poses: they must come out as they were.
        ahead = np.stack([np.cos(heading), np.sin(heading)], -1)[:, :, None] * length / 2
        left = np.stack([-np.sin(heading), np.cos(heading)], -1)[:, :, None] * width / 2
        sides = np.concatenate([ahead + left, ahead - left, -ahead - left, -ahead + left], axis=2)
        gap = np.abs(centre[:, :, None] + sides - corners)[:, -1].max()
        if not gap < 0.01:
            stop(f"{path}: corners of `{key}` are up to {gap:.3f} m off those of a box of {length} by {width} m, expected 0.01 m")
        poses[name] = np.concatenate([centre, heading[..., None]], axis=-1).astype(np.float32)
    return poses


def map_vocabulary(path):
    """Curves [curves, 11, 2]."""
    curves = np.asarray(read_pickle(path, "traj_src"), dtype=np.float32)
    if curves.ndim != 3 or curves.shape[1:] != (11, 2):
        stop(f"{path}: `traj_src` is {list(curves.shape)}, expected [curves, 11, 2]")
    return curves


def network(state):
    """The tensors of the network under the names that reactsim knows, and the names of the others."""
    mark = "map_encoder.type_pt_emb.weight"
    prefixes = [name[: -len(mark)] for name in state if name.endswith(mark)]
    if len(prefixes) != 1:
        stop(f"{len(prefixes)} tensors are called ...{mark}, expected 1; there are {', '.join(list(state)[:5])} ...")
    inside = re.compile(re.escape(prefixes[0]) + r"((map|agent)_encoder\..*)")
    own = {m[1]: value for name, value in state.items() if (m := inside.fullmatch(name))}
    return own, [name for name in state if not inside.fullmatch(name)]


def rows(own, name, dimension=0):
    if name not in own:
        stop(f"the checkpoint has no tensor `{name}`")
    return own[name].shape[dimension]


def configuration(own, vocabulary, curves, options):
    """The configuration of the network, under the names of the published ones."""
    layers = lambda kind: len({name.split(".")[2] for name in own if name.startswith(kind)})  # noqa: E731
    width, attended = own["map_encoder.type_pt_emb.weight"].shape[1], rows(own, "agent_encoder.t_attn_layers.0.to_q.weight")
    for name, expected in [("map_encoder.type_pt_emb", 10), ("map_encoder.light_pl_emb", 5), ("agent_encoder.type_a_emb", 3)]:
        if (found := rows(own, f"{name}.weight")) != expected:
            stop(f"`{name}` tells {found} kinds apart, expected {expected}, those of CATK and TrajTok: the codes are others")
    heads = options.heads or HEADS.get(attended) or stop(f"give --heads: they are {attended} wide together")
    if attended % heads:
        stop(f"{heads} heads cannot be {attended} wide together")
    if width not in REACHES and None in (options.pl2pl, options.pl2a, options.a2a, options.time_span):
        stop(f"give --pl2pl, --pl2a, --a2a and --time-span: no published network is {width} wide")
    given = (options.pl2pl, options.pl2a, options.a2a, options.time_span)
    reach = [default if own_value is None else own_value for own_value, default in zip(given, REACHES.get(width, given))]
    head = "agent_encoder.token_predict_head"
    if f"{head}.mlp.3.weight" in own:
        counts = rows(own, f"{head}.mlp.3.weight")
        by_class = {key: counts for key in BOXES}
    else:
        counts = by_class = {key: rows(own, f"{head}.{key}.mlp.3.weight") for key in BOXES}
    for key, (name, _, _) in BOXES.items():
        if len(vocabulary[name]) != by_class[key]:
            stop(f"the vocabulary has {len(vocabulary[name])} tokens of `{key}`, the network scores {by_class[key]}")
    return {
        "hidden_dim": width,
        "num_freq_bands": rows(own, "map_encoder.r_pt2pt_emb.freqs.weight", 1),
        "num_heads": heads,
        "head_dim": attended // heads,
        "dropout": 0.1,
        "num_map_layers": layers("map_encoder.pt2pt_layers."),
        "num_agent_layers": layers("agent_encoder.t_attn_layers."),
        "pl2pl_radius": reach[0],
        "pl2a_radius": reach[1],
        "a2a_radius": reach[2],
        "time_span": reach[3],
        "n_token_agent": counts,
        "n_token_map": len(curves),
        "mlp_embedding_first_width": rows(own, "map_encoder.token_emb.mlp.0.weight"),
        "feed_forward": "relu" if "agent_encoder.t_attn_layers.0.ff_mlp.0.weight" in own else "swiglu",
    }


def expected(config):
    """The names of all tensors that reactsim knows."""
    both = lambda *names: [f"{name}.{part}" for name in names for part in ("weight", "bias")]  # noqa: E731
    mlp = lambda name, *places: both(*(f"{name}.mlp.{place}" for place in places))  # noqa: E731

    def fourier(name, scalars):
        inner = [f"{name}.mlps.{d}.{place}" for d in range(scalars) for place in (0, 1, 3)]
        return [f"{name}.freqs.weight"] + both(*inner, f"{name}.to_out.0", f"{name}.to_out.2")

    def attention(name, count):
        feed = ("ff_mlp.0", "ff_mlp.3") if config["feed_forward"] == "relu" else ("ff_mlp.w12", "ff_mlp.w3")
        parts = ("attn_prenorm_x_src", "attn_prenorm_x_dst", "attn_prenorm_r", "attn_postnorm", "ff_prenorm", "ff_postnorm")
        parts += ("to_q", "to_v", "to_v_r", "to_s", "to_g", "to_out") + feed
        for i in range(count):
            yield from both(*(f"{name}.{i}.{part}" for part in parts))
            yield from (f"{name}.{i}.{part}.weight" for part in ("to_k", "to_k_r"))

    names = [f"map_encoder.{table}.weight" for table in ("type_pt_emb", "polygon_type_emb", "light_pl_emb")]
    names += mlp("map_encoder.token_emb", 0, 1, 3, 4, 6) + fourier("map_encoder.r_pt2pt_emb", 3)
    names += attention("map_encoder.pt2pt_layers", config["num_map_layers"])
    names += ["agent_encoder.type_a_emb.weight"] + mlp("agent_encoder.shape_emb", 0, 1, 3)
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


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name in ("checkpoint", "agent_vocabulary", "map_vocabulary", "output"):
        parser.add_argument(name)
    parser.add_argument("--pl2pl", type=float, help="map pieces see map pieces nearer than this, m (10)")
    parser.add_argument("--pl2a", type=float, help="agents see map pieces nearer than this, m (30; 1M: 20)")
    parser.add_argument("--a2a", type=float, help="agents see agents nearer than this, m (60; 1M: 20)")
    parser.add_argument("--time-span", type=int, help="how far back agents see themselves, frames (30; 1M: 20)")
    parser.add_argument("--heads", type=int, help="heads of attention (8 where they are 128 wide together, 4 where 32)")
    options = parser.parse_args()

    own, others = network(read_checkpoint(options.checkpoint))
    vocabulary, curves = agent_vocabulary(options.agent_vocabulary), map_vocabulary(options.map_vocabulary)
    config = configuration(own, vocabulary, curves, options)
    names = expected(config)
    if missing := sorted(names - own.keys()):
        stop(f"the checkpoint lacks {len(missing)} tensors: {', '.join(missing[:8])}")
    others += sorted(own.keys() - names)

    tensors = {name: own[name].detach().float().contiguous().numpy() for name in sorted(names)}
    for name, array in tensors.items():
        if not np.isfinite(array).all():
            stop(f"tensor `{name}` holds values that are not finite")
    tensors |= {f"vocabulary.{name}": poses for name, poses in vocabulary.items()}
    tensors["map_vocabulary.curves"] = curves
    made = {"method": "foreign", "settings": None, "seed": 0, "scenarios": 0, "data": ""}
    metadata = {
        "config": json.dumps({"kind": "smart", "network": config}),
        "reactsim.vocabulary": json.dumps(made),
        "reactsim.map_vocabulary": json.dumps(made),
    }
    write(options.output, tensors, metadata)
    print(json.dumps(config))
    print(f"{options.output}: {len(tensors)} tensors; {len(others)} left out")
    for name in others:
        print(f"  left out: {name}")


if __name__ == "__main__":
    main()
