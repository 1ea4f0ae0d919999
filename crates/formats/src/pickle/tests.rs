//! Pickles made by hand.

#![allow(clippy::unwrap_used, reason = "tests stop at what they did not expect")]

use reactsim_test_support::pickle as support;

use super::Pickle;

/// A pickle of protocol 4 with these instructions.
fn pickle(body: &[u8]) -> Vec<u8> {
    [&[0x80, 4], body, b"."].concat()
}

fn refusal(file: &[u8]) -> String {
    Pickle::read(file).map(|_| ()).unwrap_err()
}

fn text(text: &str) -> Vec<u8> {
    [&[0x8c, text.len() as u8], text.as_bytes()].concat()
}

fn global(module: &str, name: &str) -> Vec<u8> {
    [text(module), text(name), vec![0x93]].concat()
}

/// `{"a": array([[1, 2], [3, 4]], dtype)}` as numpy pickles it.
fn with_array(core: &str, dtype: &str, order: &str, by_column: bool, data: &[u8]) -> Vec<u8> {
    let mut body = b"}(".to_vec();
    body.extend(text("a"));
    body.extend(global(&format!("{core}.multiarray"), "_reconstruct"));
    body.extend(global("numpy", "ndarray"));
    body.extend(b"K\x00\x85C\x01b\x87R(K\x01K\x02K\x02\x86");
    body.extend(global("numpy", "dtype"));
    body.extend(text(dtype));
    body.extend(b"\x89\x88\x87R(K\x03");
    body.extend(text(order));
    body.extend(b"NNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK\x00tb");
    body.push(if by_column { 0x88 } else { 0x89 });
    body.extend([&[b'C', data.len() as u8], data].concat());
    body.extend(b"tbu");
    pickle(&body)
}

fn numbers(file: &[u8]) -> [f64; 4] {
    let pickle = Pickle::read(file).unwrap();
    let grid = pickle.root().need("a").unwrap().grid().unwrap();
    assert_eq!((grid.rows, grid.columns), (2, 2));
    [grid.at(0, 0), grid.at(0, 1), grid.at(1, 0), grid.at(1, 1)]
}

#[test]
fn arrays() {
    let little: Vec<u8> = [1.0_f32, 2.0, 3.0, -4.5].iter().flat_map(|v| v.to_le_bytes()).collect();
    let big: Vec<u8> = [1.0_f32, 2.0, 3.0, -4.5].iter().flat_map(|v| v.to_be_bytes()).collect();
    assert_eq!(numbers(&with_array("numpy.core", "f4", "<", false, &little)), [1.0, 2.0, 3.0, -4.5]);
    assert_eq!(numbers(&with_array("numpy._core", "f4", ">", false, &big)), [1.0, 2.0, 3.0, -4.5]);
    assert_eq!(numbers(&with_array("numpy.core", "f4", "<", true, &little)), [1.0, 3.0, 2.0, -4.5]);
    assert_eq!(numbers(&with_array("numpy.core", "b1", "|", false, &[1, 0, 1, 0])), [1.0, 0.0, 1.0, 0.0]);
    assert_eq!(
        numbers(&with_array("numpy.core", "i1", "|", false, &[255, 0, 127, 128])),
        [-1.0, 0.0, 127.0, -128.0]
    );
    assert_eq!(
        numbers(&with_array("numpy.core", "u2", ">", false, &[1, 0, 0, 1, 0, 2, 0, 3])),
        [256.0, 1.0, 2.0, 3.0]
    );
    let error = refusal(&with_array("numpy.core", "f4", "<", false, &little[..15]));
    assert!(error.contains("shape (2, 2) with 15 bytes, expected 16"), "{error}");
    let error = refusal(&with_array("numpy.core", "U7", "<", false, &little));
    assert!(error.contains("type `U7`, expected numbers"), "{error}");
}

#[test]
fn arrays_of_protocols_2_and_5() {
    // Protocol 2 stores bytes as latin1 text; protocol 5 uses a buffer.
    let mut two = b"\x80\x02}(X\x01\0\0\0acnumpy.core.multiarray\n_reconstruct\ncnumpy\nndarray\nK\0\x85c_codecs\nencode\nq\0X\x01\0\0\0bX\x06\0\0\0latin1\x86R\x87R(K\x01K\x02K\x02\x86cnumpy\ndtype\nX\x02\0\0\0u1\x89\x88\x87R(K\x03X\x01\0\0\0|NNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK\0tb\x89h\0X\x05\0\0\0".to_vec();
    two.extend("\u{1}\u{2}\u{3}\u{ff}".as_bytes());
    two.extend(b"X\x06\0\0\0latin1\x86Rtbu.");
    assert_eq!(numbers(&two), [1.0, 2.0, 3.0, 255.0]);
    let mut five = b"}(".to_vec();
    five.extend(text("a"));
    five.extend(global("numpy._core.numeric", "_frombuffer"));
    five.extend(b"(\x96\x04\0\0\0\0\0\0\0\x01\x02\x03\x04");
    five.extend(global("numpy", "dtype"));
    five.extend(text("u1"));
    five.extend(b"\x89\x88\x87R(K\x03");
    five.extend(text("|"));
    five.extend(b"NNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK\x00tbK\x02K\x02\x86");
    five.extend(text("C"));
    five.extend(b"tRu");
    assert_eq!(numbers(&pickle(&five)), [1.0, 2.0, 3.0, 4.0]);
}

#[test]
fn plain_values() {
    let mut body = b"}(".to_vec();
    body.extend(text("list"));
    body.extend(b"](K\x01J\xfe\xff\xff\xffM\x00\x01\x8a\x01\x80G\x3f\xf0\0\0\0\0\0\0e");
    body.extend(text("set"));
    body.extend(b"\x8f(K\x07\x90");
    body.extend(text("ordered"));
    body.extend(global("collections", "OrderedDict"));
    body.extend(b")R");
    body.extend(text("k"));
    body.extend(b"K\x05s");
    body.extend(text("default"));
    body.extend([global("collections", "defaultdict"), global("builtins", "int")].concat());
    body.extend(b"\x85R");
    body.extend(text("none"));
    body.extend(b"N");
    // Of equal keys the last one applies.
    body.extend([text("twice"), b"K\x01".to_vec(), text("twice"), b"K\x02".to_vec()].concat());
    body.extend(b"u");
    let file = pickle(&body);
    let pickle = Pickle::read(&file).unwrap();
    let root = pickle.root();
    let list = root.need("list").unwrap().grid().unwrap();
    assert_eq!((0..5).map(|i| list.at(i, 0)).collect::<Vec<_>>(), [1.0, -2.0, 256.0, -128.0, 1.0]);
    assert_eq!(root.need("set").unwrap().items().unwrap()[0].whole().unwrap(), 7);
    assert_eq!(root.need("ordered").unwrap().need("k").unwrap().whole().unwrap(), 5);
    assert!(root.need("default").unwrap().entries(0).unwrap().is_empty());
    assert!(root.get("none").unwrap().is_none() && root.get("other").unwrap().is_none());
    assert_eq!(root.need("twice").unwrap().whole().unwrap(), 2);
    let missing = root.need("other").err().unwrap().to_string();
    assert!(missing.starts_with("`other` is missing, expected"), "{missing}");
    let wrong = root.need("ordered").unwrap().need("k").unwrap().text().unwrap_err().to_string();
    assert_eq!(wrong, "ordered.k is 5, expected a text");
}

#[test]
fn nothing_is_run() {
    let call = b"X\x04\0\0\0true\x85R";
    let cases: [Vec<u8>; 6] = [
        [b"cos\nsystem\n".as_slice(), call].concat(),
        [global("os", "system"), call.to_vec()].concat(),
        b"(X\x04\0\0\0trueios\nsystem\n".to_vec(),
        [b"(cos\nsystem\n".as_slice(), b"X\x04\0\0\0trueo"].concat(),
        [global("os", "system"), b")\x81".to_vec()].concat(),
        [global("os", "system"), b"N".to_vec(), b"b".to_vec()].concat(),
    ];
    for case in cases {
        let error = refusal(&pickle(&case));
        assert!(
            error.contains("it names `os.system`, which is not run") && error.contains("save it again"),
            "{error}"
        );
    }
    for (module, name) in [
        ("builtins", "eval"),
        ("builtins", "getattr"),
        ("numpy", "load"),
        ("numpy.core.multiarray", "fromfile"),
    ] {
        assert!(refusal(&pickle(&global(module, name))).contains(&format!("`{module}.{name}`")));
    }
    // Known names are restricted in use.
    let known = |tail: &[u8]| refusal(&pickle(&[global("numpy", "ndarray"), tail.to_vec()].concat()));
    assert!(known(b"K\x05\x85R").contains("NdArray is called with 1 arguments"));
    assert!(known(b")\x81").contains("class"));
    assert!(known(b"}b").contains("a state"));
    assert!(refusal(&pickle(b"K\x05)R")).contains("calls a value that is not a name"));
    let factory =
        [global("collections", "defaultdict"), global("builtins", "int"), b"K\x05\x85R".to_vec()].concat();
    assert!(refusal(&pickle(&factory)).contains("Plain is called"));
    for outside in [b"P0\n".as_slice(), b"K\x01Q", b"\x97", b"\x82\x01", b"I01\n"] {
        refusal(&pickle(outside));
    }
}

#[test]
fn lengths_and_depths_are_bounded() {
    for opcode in [0x8e_u8, 0x8d, 0x96, 0x95] {
        for length in [u64::MAX, u64::MAX / 2, 1 << 40, 100] {
            let body = [&[opcode], length.to_le_bytes().as_slice()].concat();
            assert!(refusal(&pickle(&body)).contains("the file is cut"), "{opcode:#x} {length}");
        }
    }
    assert!(refusal(&pickle(b"B\xff\xff\xff\xff")).contains("the file is cut"));
    assert!(refusal(&pickle(b"\x8b\xff\xff\xff\x7f")).contains("the file is cut"));
    assert!(refusal(&pickle(b"\x8a\x09123456789")).contains("more than 64 bits"));
    assert!(refusal(&pickle(b"Nr\xff\xff\xff\xff")).contains("the memo has an entry"));
    assert!(refusal(&pickle(&b"(".repeat(1_000_000))).contains("nested containers"));
    assert!(refusal(&pickle(&b"N".repeat(3_000_000))).contains("on the stack"));
    assert!(refusal(&pickle(&b"N0".repeat(3_000_000))).contains("more than 2000000 values"));
    // A million lists, each appended to the previous one: deep nesting without recursion.
    let mut deep = b"]".repeat(900_000);
    deep.extend(b"a".repeat(899_999));
    Pickle::read(&pickle(&deep)).unwrap();
    // Copies of copies.
    let mut copies = b"](".to_vec();
    copies.extend(b"N".repeat(100_000));
    copies.extend(b"e\x940");
    for _ in 0..100 {
        copies.extend([global("builtins", "set"), b"h\x00\x85R0".to_vec()].concat());
    }
    copies.push(b'N');
    assert!(refusal(&pickle(&copies)).contains("are copied"));
    let shape = |sides: &[u8]| {
        let file = with_array("numpy.core", "f4", "<", false, &[0; 16]);
        let at = file.windows(5).position(|w| w == b"K\x02K\x02\x86").unwrap();
        [&file[..at], sides, b"\x86", &file[at + 5..]].concat()
    };
    let side = b"\x8a\x08\xff\xff\xff\xff\xff\xff\xff\x7f";
    assert!(refusal(&shape(&[side.as_slice(), side].concat())).contains("exceeds the memory"));
    assert!(refusal(&shape(&[side.as_slice(), b"K\x01"].concat())).contains("exceeds the memory"));
    assert!(refusal(&shape(b"J\xff\xff\xff\xffK\x02")).contains("a side of -1"));
}

#[test]
fn loops_end() {
    // A list that holds itself, and a dictionary that does.
    let file = pickle(b"]\x94h\x00a");
    let pickle_of_list = Pickle::read(&file).unwrap();
    let mut view = pickle_of_list.root();
    for _ in 0..1000 {
        view = view.items().unwrap().remove(0);
    }
    assert!(pickle_of_list.root().grid().is_err() && pickle_of_list.root().name().is_err());
    let file = pickle(&[b"}\x94".to_vec(), text("a"), b"h\x00s".to_vec()].concat());
    let pickle_of_dict = Pickle::read(&file).unwrap();
    assert!(pickle_of_dict.root().need("a").unwrap().need("a").unwrap().is_dict());
    assert!(pickle_of_dict.root().points().is_err());
    assert!(refusal(&pickle(b"h\x00")).contains("the memo has no entry 0"));
    // Many references to one list: extracted items are counted.
    let mut many = b"](".to_vec();
    many.extend(b"K\x01".repeat(50_000));
    many.extend(b"e\x940](");
    many.extend(b"h\x00".repeat(10_000));
    many.push(b'e');
    let file = pickle(&many);
    let pickle_of_many = Pickle::read(&file).unwrap();
    let error = pickle_of_many.root().grid().err().unwrap().to_string();
    assert!(error.contains("at most four million points and entries"), "{error}");
    // Many references to one long name: each becomes a separate string.
    let mut names = [b"X\0\x01\0\0".as_slice(), &b"n".repeat(256), b"\x940]("].concat();
    names.extend(b"h\x00".repeat(50_000));
    names.push(b'e');
    let file = pickle(&names);
    let pickle_of_names = Pickle::read(&file).unwrap();
    let root = pickle_of_names.root();
    let take = || root.items()?.iter().map(|item| item.name()).collect::<Result<Vec<_>, _>>();
    assert_eq!(take().unwrap().len(), 50_000);
    let error = (0..4).find_map(|_| take().err()).unwrap().to_string();
    assert!(error.contains("at most four million points and entries"), "{error}");
}

#[test]
fn damage_is_an_error() {
    let valid = with_array("numpy.core", "f4", "<", false, &[0; 16]);
    numbers(&valid);
    for length in 0..valid.len() {
        refusal(&valid[..length]);
    }
    for (at, change) in (0..valid.len()).flat_map(|at| [0x01, 0x20, 0x80, 0xff].map(|c| (at, c))) {
        let mut bad = valid.clone();
        bad[at] ^= change;
        if let Ok(pickle) = Pickle::read(&bad) {
            let _ = pickle.root().need("a").and_then(|a| a.points());
        }
    }
    let no_stop = refusal(&valid[..valid.len() - 1]);
    assert!(no_stop.contains("the file is cut"), "{no_stop}");
    assert!(refusal(b"\x80\x03").contains("the file is cut"));
    assert!(refusal(b"\x80\x00N.").contains("protocol 0, expected 2 to 5"));
    assert!(refusal(b"(lp0\n.").contains("does not begin as pickles"));
    assert!(refusal(&pickle(b"NN")).contains("values that belong to nothing"));
    assert!(refusal(&pickle(b"(N")).contains("values that belong to nothing"));
    for empty in [
        b"".as_slice(),
        b"0",
        b"1",
        b"2",
        b"a",
        b"e",
        b"s",
        b"u",
        b"R",
        b"b",
        b"t",
        b"\x85",
        b"\x94",
        b"(\x85",
        b"N(a",
        b"\x93",
    ] {
        refusal(&pickle(empty));
    }
    assert!(refusal(&pickle(b"}(Nu")).contains("a key without a value"));
    assert!(refusal(&pickle(b"X\x02\0\0\0\xff\xfe")).contains("UTF-8"));
}

#[test]
fn objects_of_any_class_are_read_but_nothing_that_runs_code() {
    let objects = |body: &[u8]| Pickle::read_objects(&pickle(body)).map(|_| ());
    let new = [b")\x81".as_slice(), b"X\x04\0\0\0true\x85\x81", b"X\x04\0\0\0true\x85R", b"(K\x01K\x02tR"];
    for (module, name) in [
        ("builtins", "eval"),
        ("timeit", "Timer"),
        ("io", "FileIO"),
        ("pathlib", "os.system"),
        ("_pickle", "loads"),
        ("asyncio.subprocess", "Process"),
        ("pip._internal", "Main"),
        ("torch.hub", "load"),
        ("numpy", "load"),
    ] {
        for tail in new {
            let error = objects(&[global(module, name).as_slice(), tail].concat()).unwrap_err();
            assert!(error.contains(&format!("tries to run code: it calls `{module}.{name}`")), "{error}");
        }
        let class = [global("copyreg", "_reconstructor"), b"(".to_vec(), global(module, name)].concat();
        let error = objects(&[class, global("builtins", "object"), b"NtR".to_vec()].concat()).unwrap_err();
        assert!(error.contains("tries to run code"), "{error}");
    }
    for (module, name) in [
        ("planner.output", "Trajectory"),
        ("builtins", "range"),
        ("__builtin__", "xrange"),
        ("datetime", "datetime"),
        ("pathlib", "PosixPath"),
    ] {
        for tail in new {
            objects(&[global(module, name).as_slice(), tail].concat()).unwrap();
        }
    }
    objects(&[global("collections", "deque"), b")K\x09\x86R(K\x01e".to_vec()].concat()).unwrap();
}

#[test]
fn other_types_of_arrays_do_no_harm() {
    let halves: Vec<u8> = [0x3c00_u16, 0xc500, 0x0001, 0x7c00].iter().flat_map(|v| v.to_le_bytes()).collect();
    let expected = [1.0, -5.0, 1.0 / f64::from(1 << 24), f64::INFINITY];
    assert_eq!(numbers(&with_array("numpy.core", "f2", "<", false, &halves)), expected);
    let texts = with_array("numpy.core", "U1", "<", false, &[0; 16]);
    let read = Pickle::read_objects(&texts).unwrap();
    assert!(read.root().need("a").unwrap().grid().is_err());
    assert!(refusal(&texts).contains("type `U1`"));
}

#[test]
fn tensors_of_odd_shapes_and_nested_storages_are_refused() {
    for (shape, strides) in [(vec![2, 2, 2], vec![1]), (vec![2], vec![]), (vec![2], vec![1, 1])] {
        let file = support::pickle(&support::Py::Tensor(shape, strides, vec![0.0; 8]), 4, 2);
        let error = Pickle::read_objects(&file).map(|_| ()).unwrap_err();
        assert!(error.contains("sides and strides"), "{error}");
    }
    const HEAD: &[u8] = b"\x80\x02\x8a\x0a\x6c\xfc\x9c\x46\xf9\x20\x6a\xa8\x50\x19.";
    let mut bytes = HEAD.to_vec();
    for _ in 0..2000 {
        let call =
            [b"\x80\x04".to_vec(), global("torch.storage", "_load_from_bytes"), b"B".to_vec()].concat();
        let length = (bytes.len() as u32).to_le_bytes();
        bytes = [HEAD, &call, &length, &bytes, b"\x85R."].concat();
    }
    let body = [global("torch.storage", "_load_from_bytes"), b"B".to_vec()].concat();
    let length = (bytes.len() as u32).to_le_bytes();
    let file = pickle(&[body.as_slice(), &length, &bytes, b"\x85R"].concat());
    assert!(Pickle::read_objects(&file).map(|_| ()).unwrap_err().contains("Storage is called"));
}
