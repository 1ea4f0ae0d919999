//! Calls of names, and building of their results.

use super::super::array::{Array, Content, Dtype, Kind, folded, strides_of};
use super::super::globals::{Global, attack};
use super::super::{Id, Names, Node};
use super::{Machine, run};

/// Maximum number of entries that are copied between containers.
const MAX_COPIED_ENTRIES: usize = 1_000_000;
/// Maximum number of bytes that are decoded from texts (protocol 2 stores bytes as texts).
const MAX_ENCODED_BYTES: usize = 1 << 26;

impl Machine<'_> {
    pub(super) fn call(&mut self, callee: Id, arguments: Id) -> Result<Node, String> {
        let callee = match self.node(callee) {
            Node::Global(callee) => *callee,
            // What it would make is represented by what it would be made of.
            Node::Class(name) => return attack(name).map_or_else(|| self.object(arguments), Err),
            _ => return Err("it calls a value that is not a name".into()),
        };
        let arguments = self.tuple(arguments)?;
        Ok(match (callee, arguments) {
            (Global::Reconstruct, [_, _, _]) => Node::Array(Box::new(Array::empty())),
            (Global::Dtype, [name, ..]) => {
                let name = self.name(*name)?;
                let other = || Dtype::other(name).filter(|_| !matches!(self.names, Names::Listed));
                let dtype = Dtype::from_name(name).or_else(other).ok_or_else(|| {
                    let shown: String = name.chars().take(20).collect();
                    format!(
                        "an array of type `{}`, expected numbers such as f4, f8, i8 or b1",
                        shown.escape_debug()
                    )
                })?;
                Node::Dtype(dtype)
            }
            (Global::FromBuffer, [data, dtype, shape, order]) => {
                let by_column = match self.name(*order)? {
                    "C" => false,
                    "F" => true,
                    _ => return Err("an array whose order is neither `C` nor `F`".into()),
                };
                Node::Array(Box::new(self.array(*shape, *dtype, by_column, *data)?))
            }
            (Global::Scalar, [dtype, data]) => {
                let (Node::Dtype(dtype), Some(bytes)) = (self.node(*dtype), self.raw(*data)) else {
                    return Err("a numpy number without a type or bytes".into());
                };
                if bytes.len() != dtype.size {
                    return Err(format!(
                        "a numpy number with {} bytes, expected {}",
                        bytes.len(),
                        dtype.size
                    ));
                }
                let number = dtype.number(bytes);
                match dtype.kind {
                    Kind::Bool => Node::Bool(number != 0.0),
                    Kind::Float => Node::Float(number),
                    // Exact up to 2^53, which ids of map features do not reach.
                    Kind::Signed | Kind::Unsigned => Node::Int(number as i64),
                    Kind::Other => Node::None,
                    Kind::Object => return Err("a numpy number of an object type".into()),
                }
            }
            (Global::Dict | Global::Set, []) | (Global::DefaultDict, [] | [_]) => match callee {
                Global::Set => Node::List(Vec::new()),
                _ => Node::Dict(Vec::new()),
            },
            (Global::Set, [items, ..]) => match self.node(*items) {
                Node::List(all) | Node::Tuple(all) => {
                    let all = all.clone();
                    self.copies(all.len())?;
                    Node::List(all)
                }
                _ => return Err("a set from a value that is not a list".into()),
            },
            (Global::Dict, [pairs]) => {
                let Node::List(pairs) = self.node(*pairs) else {
                    return Err("a dictionary from a value that is not a list".into());
                };
                if pairs.len() > MAX_COPIED_ENTRIES {
                    return Err("a dictionary of too many entries".into());
                }
                let mut all = Vec::with_capacity(pairs.len());
                for pair in pairs {
                    match self.node(*pair) {
                        Node::List(kv) | Node::Tuple(kv) if kv.len() == 2 => all.push((kv[0], kv[1])),
                        _ => return Err("a dictionary from values that are not pairs".into()),
                    }
                }
                self.copies(all.len())?;
                Node::Dict(all)
            }
            (Global::NewObject, [class, ..]) => {
                if let Node::Class(name) = self.node(*class) {
                    attack(name).map_or(Ok(()), Err)?;
                }
                Node::Dict(Vec::new())
            }
            // A storage contains no storages.
            (Global::Storage, [bytes]) if matches!(self.names, Names::Any(_)) => {
                self.storage_of_bytes(*bytes)?
            }
            (Global::Tensor, [storage, offset, size, stride, ..]) => {
                let Node::Array(storage) = self.node(*storage) else {
                    return Err("a tensor without a storage".into());
                };
                let Node::Int(offset) = *self.node(*offset) else {
                    return Err("a tensor without an offset".into());
                };
                let parts = folded(&self.sides(*size)?, &self.sides(*stride)?);
                let (shape, strides) = parts.ok_or("a tensor whose sides and strides do not fit")?;
                let (dtype, content) = (storage.dtype, storage.content.clone());
                let offset = usize::try_from(offset).ok().and_then(|o| o.checked_mul(dtype.size));
                let start = offset.and_then(|o| o.checked_add(storage.start));
                let tensor = Array { dtype, shape, strides, start: start.unwrap_or(usize::MAX), content };
                if !tensor.is_within(storage.start + storage.shape[1] * dtype.size) {
                    return Err(format!("a tensor of shape {} beyond its storage", tensor.shown()));
                }
                Node::Array(Box::new(tensor))
            }
            (Global::Encode, [text, codec]) => {
                if !matches!(self.name(*codec)?, "latin1" | "latin-1") {
                    return Err("bytes in another encoding than latin1".into());
                }
                let text = self.name(*text)?;
                self.encoded += text.len();
                if self.encoded > MAX_ENCODED_BYTES {
                    return Err(format!(
                        "it stores more than {} MiB of bytes as text",
                        MAX_ENCODED_BYTES >> 20
                    ));
                }
                let bytes: Option<Vec<u8>> = text.chars().map(|c| u8::try_from(u32::from(c)).ok()).collect();
                Node::OwnedBytes(bytes.ok_or("bytes in another encoding than latin1")?)
            }
            _ => return Err(format!("{callee:?} is called with {} arguments", arguments.len())),
        })
    }

    /// Returns an object: the arguments from which it is made, or, without any, its attributes, which follow.
    pub(super) fn object(&mut self, arguments: Id) -> Result<Node, String> {
        let arguments = self.tuple(arguments)?.to_vec();
        self.copies(arguments.len())?;
        Ok(if arguments.is_empty() { Node::Dict(Vec::new()) } else { Node::Tuple(arguments) })
    }

    /// Returns the storage with a description: `storage`, type, key, place and number of entries.
    pub(super) fn storage(&self, id: Id) -> Result<Node, String> {
        let [_, kind, key, _, count, ..] = self.tuple(id)? else {
            return Err("it refers to a value outside the file that is no storage of a tensor".into());
        };
        let (Node::Global(Global::StorageOf(dtype)), Node::Int(count)) =
            (self.node(*kind), self.node(*count))
        else {
            return Err("a tensor of numbers other than floats and integers".into());
        };
        let count = usize::try_from(*count).map_err(|_| format!("a storage of {count} numbers"))?;
        let content = match &self.names {
            Names::Any(storages) => {
                let key = self.name(*key)?;
                let range = storages.get(key).ok_or("a tensor whose numbers are outside the file")?;
                if count.checked_mul(dtype.size) != Some(range.len()) {
                    return Err(format!("a storage of {count} numbers with {} bytes", range.len()));
                }
                Content::File(range.clone())
            }
            Names::Listed | Names::Storage => Content::Missing,
        };
        let (shape, strides) = ([1, count, 1], [0, 1, 0]);
        Ok(Node::Array(Box::new(Array { dtype: *dtype, shape, strides, start: 0, content })))
    }

    /// Returns the storage in bytes that PyTorch wrote: a magic number, two descriptions of the program, that
    /// of the storage, its key, the number of its entries, and the entries.
    fn storage_of_bytes(&self, id: Id) -> Result<Node, String> {
        const MAGIC: &[u8] = b"\x80\x02\x8a\x0a\x6c\xfc\x9c\x46\xf9\x20\x6a\xa8\x50\x19.";
        let Some(bytes) = self.raw(id).filter(|bytes| bytes.starts_with(MAGIC)) else {
            return Err("a storage of a tensor in an unknown format; save numpy arrays".into());
        };
        let (mut at, mut described) = (MAGIC.len(), None);
        for _ in 0..3 {
            let (mut nodes, root, end) = run(bytes, at..bytes.len(), Names::Storage)?;
            (at, described) = (end, Some(nodes.swap_remove(root as usize)));
        }
        let Some(Node::Array(mut storage)) = described else {
            return Err("a tensor without the description of its storage".into());
        };
        let length = storage.shape[1].checked_mul(storage.dtype.size).filter(|n| *n + 8 <= bytes.len() - at);
        let start = bytes.len() - length.ok_or("a storage that is cut; fetch the file again")?;
        storage.start = start;
        storage.content = match self.node(id) {
            Node::Bytes(range) => Content::File(range.clone()),
            _ => Content::Value(id),
        };
        Ok(Node::Array(storage))
    }

    /// Counts copied entries against their limit.
    fn copies(&mut self, entries: usize) -> Result<(), String> {
        self.copied += entries;
        if self.copied > MAX_COPIED_ENTRIES {
            return Err(format!("more than {MAX_COPIED_ENTRIES} entries are copied"));
        }
        Ok(())
    }

    fn raw(&self, id: Id) -> Option<&[u8]> {
        match self.node(id) {
            Node::Bytes(r) => Some(&self.file[r.start as usize..r.end as usize]),
            Node::OwnedBytes(bytes) => Some(bytes),
            _ => None,
        }
    }

    /// Sets the state of an object created by a call.
    pub(super) fn build(&mut self, object: Id, state: Id) -> Result<(), String> {
        match self.node(object) {
            Node::Array(_) => {
                let [_, shape, dtype, by_column, data] = *self.tuple(state)? else {
                    return Err("the state of an array does not have five parts".into());
                };
                let by_column = match self.node(by_column) {
                    Node::Bool(b) => *b,
                    Node::Int(i) => *i != 0,
                    _ => return Err("the state of an array has no order".into()),
                };
                let array = self.array(shape, dtype, by_column, data)?;
                self.nodes[object as usize] = Node::Array(Box::new(array));
            }
            Node::Dtype(dtype) => {
                let mut dtype = *dtype;
                let state = self.tuple(state)?;
                let (Some(order), Some(fields)) = (state.get(1), state.get(3)) else {
                    return Err("the state of a number type does not have eight parts".into());
                };
                if !matches!(self.node(*fields), Node::None) {
                    return Err("an array of records, expected one of numbers".into());
                }
                dtype.big_endian = self.name(*order)? == ">";
                self.nodes[object as usize] = Node::Dtype(dtype);
            }
            // Attributes of a dictionary subclass are not part of a scenario.
            Node::Dict(_) if matches!(self.names, Names::Listed) => {}
            Node::Dict(_) | Node::Tuple(_) if !matches!(self.names, Names::Listed) => {
                self.set_attributes(object, state)?;
            }
            _ => return Err("a state for a value without one".into()),
        }
        Ok(())
    }

    /// Adds attributes, which are a dictionary, or two of which one may be missing.
    fn set_attributes(&mut self, object: Id, state: Id) -> Result<(), String> {
        let parts = match self.node(state) {
            Node::Tuple(parts) => parts.clone(),
            _ => vec![state],
        };
        let dicts = parts.iter().filter_map(|part| match self.node(*part) {
            Node::Dict(entries) => Some(entries.as_slice()),
            _ => None,
        });
        let attributes = dicts.collect::<Vec<_>>().concat();
        self.copies(attributes.len() + parts.len())?;
        match &mut self.nodes[object as usize] {
            Node::Dict(entries) => entries.extend(attributes),
            _ if attributes.is_empty() => {}
            other => *other = Node::Dict(attributes),
        }
        Ok(())
    }

    /// Returns the lengths in a tuple.
    fn sides(&self, shape: Id) -> Result<Vec<usize>, String> {
        let side = |id: &Id| match self.node(*id) {
            Node::Int(side) => usize::try_from(*side).map_err(|_| format!("an array with a side of {side}")),
            _ => Err("the shape of an array is not made of whole numbers".into()),
        };
        self.tuple(shape)?.iter().map(side).collect()
    }

    fn array(&self, shape: Id, dtype: Id, by_column: bool, data: Id) -> Result<Array, String> {
        let Node::Dtype(dtype) = *self.node(dtype) else {
            return Err("an array without a type".into());
        };
        let sides = self.sides(shape)?;
        if sides.len() > 2 && matches!(self.names, Names::Listed) {
            return Err(format!("an array of {} dimensions, expected one or two", sides.len()));
        }
        let count = sides.iter().try_fold(1_usize, |count, side| count.checked_mul(*side));
        let count = count.ok_or("an array that exceeds the memory")?;
        let parts = folded(&sides, &strides_of(&sides, by_column));
        let (shape, strides) = parts.ok_or("an array of more than three dimensions in Fortran order")?;
        let mut array = Array { dtype, shape, strides, start: 0, content: Content::Missing };
        array.content = match (self.node(data), dtype.kind) {
            (Node::List(items), Kind::Object) if items.len() == count => Content::Value(data),
            (Node::Bytes(range), kind) if kind != Kind::Object => Content::File(range.clone()),
            (Node::OwnedBytes(_), kind) if kind != Kind::Object => Content::Value(data),
            _ => return Err(format!("an array of shape {} without content", array.shown())),
        };
        if let Some(bytes) = self.raw(data) {
            let expected = count.checked_mul(dtype.size).ok_or("an array that exceeds the memory")?;
            if bytes.len() != expected {
                let found = bytes.len();
                return Err(format!(
                    "an array of shape {} with {found} bytes, expected {expected}",
                    array.shown()
                ));
            }
        }
        Ok(array)
    }
}
