//! Calls of names, and building of their results.

use super::super::array::{Array, Content, Dtype, Kind};
use super::super::globals::Global;
use super::super::{Id, Node};
use super::Machine;

/// Maximum number of entries that are copied between containers.
const MAX_COPIED_ENTRIES: usize = 1_000_000;
/// Maximum number of bytes that are decoded from texts (protocol 2 stores bytes as texts).
const MAX_ENCODED_BYTES: usize = 1 << 26;

impl Machine<'_> {
    /// Calls a name with arguments.
    pub(super) fn call(&mut self, callee: Id, arguments: Id) -> Result<Node, String> {
        let Node::Global(callee) = *self.node(callee) else {
            return Err("it calls a value that is not a name".into());
        };
        let arguments = self.tuple(arguments)?;
        Ok(match (callee, arguments) {
            (Global::Reconstruct, [_, _, _]) => Node::Array(Box::new(Array::empty())),
            (Global::Dtype, [name, ..]) => {
                let name = self.name(*name)?;
                let dtype = Dtype::from_name(name).ok_or_else(|| {
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
                    Kind::Object => return Err("a numpy number of an object type".into()),
                }
            }
            (Global::Dict | Global::Set, []) | (Global::DefaultDict, [] | [_]) => match callee {
                Global::Set => Node::List(Vec::new()),
                _ => Node::Dict(Vec::new()),
            },
            (Global::Set, [items]) => match self.node(*items) {
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
            // Attributes of a dictionary subclass are not part of the scenario.
            Node::Dict(_) => {}
            _ => return Err("a state for a value without one".into()),
        }
        Ok(())
    }

    fn array(&self, shape: Id, dtype: Id, by_column: bool, data: Id) -> Result<Array, String> {
        let Node::Dtype(dtype) = *self.node(dtype) else {
            return Err("an array without a type".into());
        };
        let mut sides = [1_usize; 2];
        let shape = self.tuple(shape)?;
        if shape.len() > 2 {
            return Err(format!("an array of {} dimensions, expected one or two", shape.len()));
        }
        for (side, given) in sides.iter_mut().zip(shape) {
            let Node::Int(given) = self.node(*given) else {
                return Err("the shape of an array is not made of whole numbers".into());
            };
            *side = usize::try_from(*given).map_err(|_| format!("an array with a side of {given}"))?;
        }
        let [rows, columns] = sides;
        let count = rows.checked_mul(columns).ok_or("an array that exceeds the memory")?;
        let content = match (self.node(data), dtype.kind) {
            (Node::List(items), Kind::Object) if items.len() == count => Content::Value(data),
            (Node::Bytes(range), kind) if kind != Kind::Object => Content::File(range.clone()),
            (Node::OwnedBytes(_), kind) if kind != Kind::Object => Content::Value(data),
            _ => return Err(format!("an array of shape ({rows}, {columns}) without content")),
        };
        if let Some(bytes) = self.raw(data) {
            let expected = count.checked_mul(dtype.size).ok_or("an array that exceeds the memory")?;
            if bytes.len() != expected {
                let found = bytes.len();
                return Err(format!(
                    "an array of shape ({rows}, {columns}) with {found} bytes, expected {expected}"
                ));
            }
        }
        Ok(Array { dtype, rows, columns, by_column, content })
    }
}
