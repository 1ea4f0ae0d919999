//! Pickles as Python, numpy and PyTorch write them.

/// Value of Python.
#[derive(Clone)]
#[expect(missing_docs, reason = "values of Python")]
pub enum Py {
    None,
    Bool(bool),
    Num(f64),
    Int(i64),
    Text(String),
    List(Vec<Self>),
    Tuple(Vec<Self>),
    Dict(Vec<(String, Self)>),
    /// Shape and numbers of an array.
    Array(Vec<usize>, Vec<f64>),
    /// Shape, strides and storage of a tensor of 32-bit floats.
    Tensor(Vec<usize>, Vec<usize>, Vec<f64>),
    /// Object of a class with attributes.
    Object(Box<Self>),
    /// Call of a name with a text.
    Call(&'static str, &'static str, &'static str),
}

/// Magic number of PyTorch, versions, and the description of a storage without the number of its entries.
const STORAGE: &[&[u8]] = &[
    b"\x80\x02\x8a\x0a\x6c\xfc\x9c\x46\xf9\x20\x6a\xa8\x50\x19.",
    b"\x80\x02M\xe9\x03.",
    b"\x80\x02}.",
    b"\x80\x02(X\x07\0\0\0storagectorch\nFloatStorage\nX\x01\0\0\x000X\x03\0\0\0cpuJ",
];

struct Writer {
    out: Vec<u8>,
    protocol: u8,
    core: &'static str,
}

/// Returns the pickle of a value, with the names of numpy 1 or 2.
pub fn pickle(value: &Py, protocol: u8, numpy: u8) -> Vec<u8> {
    let core = if numpy == 1 { "numpy.core" } else { "numpy._core" };
    let mut writer = Writer { out: vec![0x80, protocol], protocol, core };
    writer.value(value);
    writer.put(b".");
    writer.out
}

/// Returns an archive of PyTorch with one tensor of 32-bit floats under a key.
pub fn archive(key: &str, shape: &[usize], numbers: &[f64]) -> Vec<u8> {
    let mut writer = Writer { out: vec![0x80, 2], protocol: 2, core: "numpy.core" };
    writer.put(b"}");
    writer.text(key);
    writer.tensor(shape, &strides(shape), |w| {
        w.put(&STORAGE[3][2..]);
        w.put(&(numbers.len() as u32).to_le_bytes());
        w.put(b"tQ");
    });
    writer.put(b"s.");
    let parts = [("a/data.pkl", writer.out), ("a/data/0", floats(numbers))];
    let (mut out, mut list) = (Vec::new(), Vec::new());
    for (name, content) in &parts {
        let (at, size, length) = (out.len() as u32, content.len() as u32, name.len() as u16);
        let about =
            [&[0; 12][..], &size.to_le_bytes(), &size.to_le_bytes(), &length.to_le_bytes(), &[0; 2]].concat();
        out.extend([b"PK\x03\x04\0\0", &about[..], name.as_bytes(), content].concat());
        list.extend(
            [b"PK\x01\x02\0\0\0\0", &about[..], &[0; 10][..], &at.to_le_bytes(), name.as_bytes()].concat(),
        );
    }
    let (at, size) = (out.len() as u32, list.len() as u32);
    out.extend(list);
    out.extend(
        [b"PK\x05\x06\0\0\0\0\x02\0\x02\0", &size.to_le_bytes()[..], &at.to_le_bytes(), &[0; 2]].concat(),
    );
    out
}

/// Returns the strides of an array without gaps.
pub fn strides(shape: &[usize]) -> Vec<usize> {
    (0..shape.len()).map(|i| shape[i + 1..].iter().product()).collect()
}

fn floats(numbers: &[f64]) -> Vec<u8> {
    numbers.iter().flat_map(|v| (*v as f32).to_le_bytes()).collect()
}

impl Writer {
    fn put(&mut self, bytes: &[u8]) {
        self.out.extend(bytes);
    }

    fn text(&mut self, text: &str) {
        self.put(b"X");
        self.put(&(text.len() as u32).to_le_bytes());
        self.put(text.as_bytes());
    }

    fn name(&mut self, module: &str, name: &str) {
        if self.protocol < 4 {
            return self.put(format!("c{module}\n{name}\n").as_bytes());
        }
        self.text(module);
        self.text(name);
        self.put(&[0x93]);
    }

    fn bytes(&mut self, bytes: &[u8]) {
        if self.protocol > 2 {
            self.put(b"B");
            self.put(&(bytes.len() as u32).to_le_bytes());
            return self.put(bytes);
        }
        // Protocol 2 has texts only.
        self.name("_codecs", "encode");
        self.text(&bytes.iter().map(|b| char::from(*b)).collect::<String>());
        self.text("latin1");
        self.put(b"\x86R");
    }

    fn sides(&mut self, sides: &[usize]) {
        self.put(b"(");
        for side in sides {
            self.put(b"J");
            self.put(&(*side as u32).to_le_bytes());
        }
        self.put(b"t");
    }

    fn tensor(&mut self, shape: &[usize], strides: &[usize], storage: impl FnOnce(&mut Self)) {
        self.name("torch._utils", "_rebuild_tensor_v2");
        self.put(b"(");
        storage(self);
        self.put(b"K\0");
        self.sides(shape);
        self.sides(strides);
        self.put(b"\x89");
        self.name("collections", "OrderedDict");
        self.put(b")RtR");
    }

    fn value(&mut self, value: &Py) {
        match value {
            Py::None => self.put(b"N"),
            Py::Bool(is) => self.put(if *is { b"\x88" } else { b"\x89" }),
            Py::Num(number) => {
                self.put(b"G");
                self.put(&number.to_be_bytes());
            }
            Py::Int(number) => {
                self.put(b"\x8a\x08");
                self.put(&number.to_le_bytes());
            }
            Py::Text(text) => self.text(text),
            Py::List(all) => {
                self.put(b"](");
                all.iter().for_each(|one| self.value(one));
                self.put(b"e");
            }
            Py::Tuple(all) => {
                self.put(b"(");
                all.iter().for_each(|one| self.value(one));
                self.put(b"t");
            }
            Py::Dict(all) => {
                self.put(b"}(");
                for (key, one) in all {
                    self.text(key);
                    self.value(one);
                }
                self.put(b"u");
            }
            Py::Array(shape, numbers) => {
                self.name(&format!("{}.multiarray", self.core), "_reconstruct");
                self.name("numpy", "ndarray");
                self.put(b"K\0\x85");
                self.bytes(b"b");
                self.put(b"\x87R(K\x01");
                self.sides(shape);
                self.name("numpy", "dtype");
                self.text("f8");
                self.put(b"\x89\x88\x87R(K\x03");
                self.text("<");
                self.put(b"NNNJ\xff\xff\xff\xffJ\xff\xff\xff\xffK\0tb\x89");
                self.bytes(&numbers.iter().flat_map(|v| v.to_le_bytes()).collect::<Vec<u8>>());
                self.put(b"tb");
            }
            Py::Tensor(shape, strides, numbers) => self.tensor(shape, strides, |w| {
                let count = (numbers.len() as u32).to_le_bytes();
                let key = b"\x80\x02]X\x01\0\0\x000a.";
                let length = (numbers.len() as u64).to_le_bytes();
                w.name("torch.storage", "_load_from_bytes");
                w.bytes(&[&STORAGE.concat(), &count[..], b"NtQ.", key, &length, &floats(numbers)].concat());
                w.put(b"\x85R");
            }),
            Py::Object(attributes) => {
                self.name("planner.output", "Trajectory");
                self.put(b")\x81");
                self.value(attributes);
                self.put(b"b");
            }
            Py::Call(module, name, argument) => {
                self.name(module, name);
                self.text(argument);
                self.put(b"\x85R");
            }
        }
    }
}
