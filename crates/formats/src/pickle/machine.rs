//! Stack machine of pickles.

mod calls;

use std::ops::Range;

use super::globals::Global;
use super::{Id, Names, Node};

/// Maximum number of values of a pickle; the largest scenarios have some hundred thousand.
const MAX_NODES: usize = 2_000_000;
/// Maximum height of the stack, on which lists are assembled.
const MAX_STACK_HEIGHT: usize = 1_000_000;
/// Maximum number of open containers; a scenario has about ten.
const MAX_DEPTH: usize = 200;
/// Maximum length in bytes of the name of a module or of its content.
const MAX_NAME_LENGTH: usize = 1000;
/// Marker of empty entries of the memo.
const EMPTY: Id = Id::MAX;

/// Runs a pickle in a part of a file; returns its values, the outermost one and where the pickle ends.
pub(super) fn run(file: &[u8], part: Range<usize>, names: Names) -> Result<(Vec<Node>, Id, usize), String> {
    let mut machine = Machine {
        file: &file[..part.end],
        at: part.start,
        names,
        nodes: Vec::new(),
        stack: Vec::new(),
        marks: Vec::new(),
        memo: Vec::new(),
        memoized: 0,
        copied: 0,
        encoded: 0,
    };
    match file[part] {
        [0x80, 2..=5, ..] => {}
        [0x80, protocol, ..] => return Err(format!("it has protocol {protocol}, expected 2 to 5")),
        _ => return Err("it does not begin as pickles of protocol 2 to 5 do; save it with protocol 4".into()),
    }
    loop {
        let at = machine.at;
        match machine.step() {
            Ok(None) => {}
            Ok(Some(root)) => return Ok((machine.nodes, root, machine.at)),
            Err(what) => return Err(format!("at byte {at}: {what}")),
        }
    }
}

struct Machine<'a> {
    file: &'a [u8],
    /// Offset of the next byte.
    at: usize,
    names: Names,
    nodes: Vec<Node>,
    stack: Vec<Id>,
    /// Heights of the stack at which containers were opened.
    marks: Vec<usize>,
    memo: Vec<Id>,
    /// Number of entries of the memo.
    memoized: usize,
    /// Number of entries copied between containers.
    copied: usize,
    /// Number of bytes decoded from texts.
    encoded: usize,
}

impl<'a> Machine<'a> {
    /// Runs one instruction; returns the outermost value after the last one.
    fn step(&mut self) -> Result<Option<Id>, String> {
        let opcode = self.take(1)?[0];
        match opcode {
            b'.' => {
                let root = self.pop()?;
                if !(self.stack.is_empty() && self.marks.is_empty()) {
                    return Err("it ends with values that belong to nothing".into());
                }
                return Ok(Some(root));
            }
            0x80 => {
                let protocol = self.take(1)?[0];
                if !(2..=5).contains(&protocol) {
                    return Err(format!("protocol {protocol}, expected 2 to 5"));
                }
            }
            0x95 => {
                let length = self.length(8)?;
                self.remains(length)?;
            }
            b'(' => {
                if self.marks.len() >= MAX_DEPTH {
                    return Err(format!("more than {MAX_DEPTH} nested containers"));
                }
                self.marks.push(self.stack.len());
            }
            b'0' => {
                if self.marks.last() == Some(&self.stack.len()) {
                    self.marks.pop();
                } else {
                    self.pop()?;
                }
            }
            b'1' => {
                self.marked()?;
            }
            b'2' => {
                let top = self.top()?;
                self.push(top)?;
            }
            b'N' => self.make(Node::None)?,
            0x88 => self.make(Node::Bool(true))?,
            0x89 => self.make(Node::Bool(false))?,
            b'K' => {
                let v = self.length(1)? as i64;
                self.make(Node::Int(v))?;
            }
            b'M' => {
                let v = self.length(2)? as i64;
                self.make(Node::Int(v))?;
            }
            b'J' => {
                let bytes = self.take(4)?;
                self.make(Node::Int(integer(bytes)?))?;
            }
            0x8a | 0x8b => {
                let length = self.length(if opcode == 0x8a { 1 } else { 4 })?;
                let bytes = self.take(length)?;
                self.make(Node::Int(integer(bytes)?))?;
            }
            b'G' => {
                let bytes = self.take(8)?;
                let float = f64::from_be_bytes(bytes.try_into().map_err(|_| "no number".to_owned())?);
                self.make(Node::Float(float))?;
            }
            b'X' => self.text(4)?,
            0x8c => self.text(1)?,
            0x8d => self.text(8)?,
            b'U' | b'C' => self.bytes(1)?,
            b'T' | b'B' => self.bytes(4)?,
            0x8e | 0x96 => self.bytes(8)?,
            b']' | 0x8f => self.make(Node::List(Vec::new()))?,
            b'}' => self.make(Node::Dict(Vec::new()))?,
            b')' => self.make(Node::Tuple(Vec::new()))?,
            0x85..=0x87 => {
                let n = usize::from(opcode - 0x84);
                let mut items = Vec::with_capacity(n);
                for _ in 0..n {
                    items.push(self.pop()?);
                }
                items.reverse();
                self.make(Node::Tuple(items))?;
            }
            b't' => {
                let items = self.marked()?;
                self.make(Node::Tuple(items))?;
            }
            0x91 => {
                let items = self.marked()?;
                self.make(Node::List(items))?;
            }
            b'a' => {
                let item = self.pop()?;
                self.extend(vec![item])?;
            }
            b'e' | 0x90 => {
                let items = self.marked()?;
                self.extend(items)?;
            }
            b's' => {
                let value = self.pop()?;
                let key = self.pop()?;
                self.set(&[key, value])?;
            }
            b'u' => {
                let items = self.marked()?;
                self.set(&items)?;
            }
            b'q' => {
                let index = self.length(1)?;
                self.put(index)?;
            }
            b'r' => {
                let index = self.length(4)?;
                self.put(index)?;
            }
            0x94 => self.put(self.memoized)?,
            b'h' => {
                let index = self.length(1)?;
                self.get(index)?;
            }
            b'j' => {
                let index = self.length(4)?;
                self.get(index)?;
            }
            b'c' => {
                let (module, name) = (self.line()?, self.line()?);
                let node = self.named(&module, &name)?;
                self.make(node)?;
            }
            0x93 => {
                let (name, module) = (self.pop()?, self.pop()?);
                let node = self.named(self.name(module)?, self.name(name)?)?;
                self.make(node)?;
            }
            b'R' => {
                let (arguments, callee) = (self.pop()?, self.pop()?);
                let made = self.call(callee, arguments)?;
                self.make(made)?;
            }
            0x81 => {
                let (arguments, class) = (self.pop()?, self.pop()?);
                match self.node(class) {
                    Node::Global(Global::Dict) => self.make(Node::Dict(Vec::new()))?,
                    Node::Class(_) => {
                        let object = self.call(class, arguments)?;
                        self.make(object)?;
                    }
                    _ => return Err("it creates an object of a class that cannot be created this way".into()),
                }
            }
            b'b' => {
                let state = self.pop()?;
                let object = self.top()?;
                self.build(object, state)?;
            }
            b'i' => {
                // Old-style classes; an unknown name is reported first.
                let (module, name) = (self.line()?, self.line()?);
                Global::find(&module, &name)?;
                return Err("it creates an object of an old-style class; save it with protocol 4".into());
            }
            b'Q' if !matches!(self.names, Names::Listed) => {
                let id = self.pop()?;
                let storage = self.storage(id)?;
                self.make(storage)?;
            }
            b'P' | b'Q' => return Err("it refers to values outside the file; save it as one file".into()),
            0x97 | 0x98 => return Err("its arrays are outside the file; save it as one file".into()),
            0x82..=0x84 => return Err("it uses the extension registry of Python".into()),
            _ => {
                return Err(format!(
                    "the opcode {opcode:#04x} is not used for plain data; save it with protocol 4"
                ));
            }
        }
        Ok(None)
    }

    /// Returns the value of a name.
    fn named(&self, module: &str, name: &str) -> Result<Node, String> {
        if matches!(self.names, Names::Listed) {
            return Global::find(module, name).map(Node::Global);
        }
        let known = Global::of_objects(module, name).or_else(|| Global::find(module, name).ok());
        Ok(known.map_or_else(|| Node::Class(format!("{module}.{name}")), Node::Global))
    }

    fn remains(&self, length: usize) -> Result<(), String> {
        let left = self.file.len() - self.at;
        if length > left {
            return Err(format!("{length} bytes expected, {left} left: the file is cut; fetch it again"));
        }
        Ok(())
    }

    fn take(&mut self, length: usize) -> Result<&'a [u8], String> {
        self.remains(length)?;
        let taken = &self.file[self.at..self.at + length];
        self.at += length;
        Ok(taken)
    }

    /// Reads an unsigned number of `bytes` bytes.
    fn length(&mut self, bytes: usize) -> Result<usize, String> {
        let mut all = [0_u8; 8];
        all[..bytes].copy_from_slice(self.take(bytes)?);
        usize::try_from(u64::from_le_bytes(all)).map_err(|_| "a length that exceeds the memory".into())
    }

    /// Reads a length of `bytes` bytes and returns the range of the content after it.
    fn range(&mut self, bytes: usize) -> Result<Range<u32>, String> {
        let length = self.length(bytes)?;
        let start = self.at;
        self.take(length)?;
        let offset = |v: usize| u32::try_from(v).map_err(|_| "the file is too long".to_owned());
        Ok(offset(start)?..offset(self.at)?)
    }

    fn text(&mut self, bytes: usize) -> Result<(), String> {
        let range = self.range(bytes)?;
        let text = &self.file[range.start as usize..range.end as usize];
        std::str::from_utf8(text).map_err(|_| "a text is not UTF-8")?;
        self.make(Node::Text(range))
    }

    fn bytes(&mut self, bytes: usize) -> Result<(), String> {
        let range = self.range(bytes)?;
        self.make(Node::Bytes(range))
    }

    fn line(&mut self) -> Result<String, String> {
        let rest = &self.file[self.at..];
        let end = rest.iter().take(MAX_NAME_LENGTH).position(|b| *b == b'\n');
        let end = end.ok_or("a name has no end")?;
        let line = self.take(end + 1)?;
        Ok(String::from_utf8_lossy(&line[..end]).into_owned())
    }

    fn push(&mut self, id: Id) -> Result<(), String> {
        if self.stack.len() >= MAX_STACK_HEIGHT {
            return Err(format!("more than {MAX_STACK_HEIGHT} values on the stack"));
        }
        self.stack.push(id);
        Ok(())
    }

    fn make(&mut self, node: Node) -> Result<(), String> {
        if self.nodes.len() >= MAX_NODES {
            return Err(format!("it holds more than {MAX_NODES} values, expected one scenario"));
        }
        let id = self.nodes.len() as Id;
        self.nodes.push(node);
        self.push(id)
    }

    /// Returns the top of the stack; values of outer containers are not accessible.
    fn top(&self) -> Result<Id, String> {
        let floor = self.marks.last().copied().unwrap_or(0);
        if self.stack.len() <= floor {
            return Err("a value is missing on the stack".into());
        }
        self.stack.last().copied().ok_or_else(|| "the stack is empty".into())
    }

    fn pop(&mut self) -> Result<Id, String> {
        let top = self.top()?;
        self.stack.pop();
        Ok(top)
    }

    /// Removes and returns all values since the last mark, and the mark.
    fn marked(&mut self) -> Result<Vec<Id>, String> {
        let mark = self.marks.pop().ok_or("a mark is missing on the stack")?;
        Ok(self.stack.split_off(mark))
    }

    fn put(&mut self, index: usize) -> Result<(), String> {
        let top = self.top()?;
        if index >= MAX_NODES {
            return Err(format!("the memo has an entry {index}, expected at most {MAX_NODES}"));
        }
        if index >= self.memo.len() {
            self.memo.resize(index + 1, EMPTY);
        }
        if self.memo[index] == EMPTY {
            self.memoized += 1;
        }
        self.memo[index] = top;
        Ok(())
    }

    fn get(&mut self, index: usize) -> Result<(), String> {
        let found = self.memo.get(index).copied().filter(|id| *id != EMPTY);
        self.push(found.ok_or_else(|| format!("the memo has no entry {index}"))?)
    }

    fn node(&self, id: Id) -> &Node {
        &self.nodes[id as usize]
    }

    fn extend(&mut self, items: Vec<Id>) -> Result<(), String> {
        let list = self.top()?;
        match &mut self.nodes[list as usize] {
            Node::List(all) => all.extend(items),
            _ => return Err("items are added to a value that is not a list".into()),
        }
        Ok(())
    }

    fn set(&mut self, items: &[Id]) -> Result<(), String> {
        let dict = self.top()?;
        if !items.len().is_multiple_of(2) {
            return Err("a key without a value".into());
        }
        match &mut self.nodes[dict as usize] {
            Node::Dict(all) => all.extend(items.chunks_exact(2).map(|pair| (pair[0], pair[1]))),
            _ => return Err("keys are set in a value that is not a dictionary".into()),
        }
        Ok(())
    }

    /// Returns a text, which may be stored as bytes.
    fn name(&self, id: Id) -> Result<&'a str, String> {
        match self.node(id) {
            Node::Text(r) | Node::Bytes(r) => {
                let text = &self.file[r.start as usize..r.end as usize];
                std::str::from_utf8(text).map_err(|_| "a name is not UTF-8".into())
            }
            _ => Err("a name is not a text".into()),
        }
    }

    fn tuple(&self, id: Id) -> Result<&[Id], String> {
        match self.node(id) {
            Node::Tuple(items) => Ok(items),
            _ => Err("arguments are not a tuple".into()),
        }
    }
}

/// Decodes a signed little-endian number.
fn integer(bytes: &[u8]) -> Result<i64, String> {
    if bytes.len() > 8 {
        return Err("a whole number of more than 64 bits".into());
    }
    let negative = bytes.last().is_some_and(|b| b & 0x80 != 0);
    let mut all = [if negative { 0xff } else { 0 }; 8];
    all[..bytes.len()].copy_from_slice(bytes);
    Ok(i64::from_le_bytes(all))
}
