//! Neighbour lists of attention: edges as rows of equal length.

use std::sync::{Arc, OnceLock};

use burn::tensor::{Device, IndexingUpdateOp, Int, Tensor, TensorData};

use super::host::Slots;
use super::rows::indices;

/// Up to K sources for each of N destinations; the remaining slots of a row are closed. A list of
/// edges is converted to this form so that attention consists of gathers and dense products.
#[derive(Clone, Debug)]
pub struct Neighbors {
    destinations: usize,
    slots: usize,
    /// Whether the row length was given by the caller, not derived from edges.
    fixed: bool,
    rows: Arc<Rows>,
    /// 1 if a destination has a source, else 0; [N, 1].
    any: Tensor<2>,
}

/// The slots, row by row.
#[derive(Debug)]
struct Rows {
    /// Row of the source of each slot, [N·K]; 0 for closed slots.
    sources: Vec<u32>,
    /// Row of the edge of each slot in the list of edges, [N·K]; 0 for closed slots.
    edges: Vec<u32>,
    /// Number of each slot, [N·K].
    numbers: Vec<u32>,
    /// Whether a slot is open, [N·K].
    open: Vec<bool>,
    /// The same on the device, made when a layer first asks for them.
    tensors: OnceLock<SlotTensors>,
}

#[derive(Debug)]
struct SlotTensors {
    /// Row of the source of each slot, [N·K].
    source: Tensor<1, Int>,
    /// Row of each slot in a table of all pairs of sources and destinations, [N·K]: source · N +
    /// destination.
    pair: Tensor<1, Int>,
    /// Row of the edge of each slot, [N·K].
    edge: Tensor<1, Int>,
    /// Offset added to scores, [N, 1, K]: 0 for open slots, very negative for closed ones.
    closed: Tensor<3>,
}

/// Offset added to the score of a closed slot, large enough that the exponential is exactly 0 in
/// f32.
const CLOSED_SCORE: f32 = -1e9;

impl Neighbors {
    /// Builds rows from edges (source, destination) in any order; the slots of a destination follow
    /// the order of its edges.
    ///
    /// # Panics
    /// If a destination is not below `destinations`, or the two lists differ in length.
    pub fn from_edges(destinations: usize, sources: &[u32], targets: &[u32], device: &Device) -> Self {
        assert_eq!(sources.len(), targets.len(), "edges have two ends");
        let mut degree = vec![0usize; destinations];
        for &target in targets {
            degree[target as usize] += 1;
        }
        let slots = degree.iter().copied().max().unwrap_or(0);
        let all = destinations * slots;
        let (mut from, mut edges, mut open) = (vec![0; all], vec![0; all], vec![false; all]);
        let mut filled = vec![0usize; destinations];
        for (edge, (&source, &to)) in (0..).zip(sources.iter().zip(targets)) {
            let to = to as usize;
            let slot = to * slots + filled[to];
            filled[to] += 1;
            (from[slot], edges[slot], open[slot]) = (source, edge, true);
        }
        Self::of(destinations, slots, false, Rows::new(from, edges, open), device)
    }

    /// Builds rows from row-major lists [N, K] of sources and of flags for open slots. Slots are
    /// edges: the relation of slot k of destination n is row n·K + k.
    ///
    /// # Panics
    /// If the lengths are not N·K.
    pub fn from_slots(
        destinations: usize,
        slots: usize,
        sources: &[u32],
        open: &[bool],
        device: &Device,
    ) -> Self {
        let all = destinations * slots;
        assert_eq!((sources.len(), open.len()), (all, all), "rows of slots");
        let from = sources.iter().zip(open).map(|(&source, &open)| if open { source } else { 0 }).collect();
        let rows = Rows::new(from, (0..all as u32).collect(), open.to_vec());
        Self::of(destinations, slots, true, rows, device)
    }

    fn of(destinations: usize, slots: usize, fixed: bool, rows: Rows, device: &Device) -> Self {
        let any = |n: usize| rows.open[n * slots..(n + 1) * slots].contains(&true);
        let any: Vec<f32> = (0..destinations).map(|n| if any(n) { 1.0 } else { 0.0 }).collect();
        let any = Tensor::from_data(TensorData::new(any, [destinations, 1]), device);
        Self { destinations, slots, fixed, rows: Arc::new(rows), any }
    }

    fn tensors(&self) -> &SlotTensors {
        self.rows.tensors.get_or_init(|| {
            let (n, k, rows) = (self.destinations, self.slots, &self.rows);
            let number = |value: &u32| *value as usize;
            let pair = |(slot, source): (usize, &u32)| *source as usize * n + slot / k;
            let closed: Vec<f32> = rows.open.iter().map(|&o| if o { 0.0 } else { CLOSED_SCORE }).collect();
            let device = self.any.device();
            SlotTensors {
                source: indices(rows.sources.iter().map(number), &device),
                pair: indices(rows.sources.iter().enumerate().map(pair), &device),
                edge: indices(rows.edges.iter().map(number), &device),
                closed: Tensor::from_data(TensorData::new(closed, [n, 1, k]), &device),
            }
        })
    }

    /// Returns the slots in host memory. Relations are those of edges or of slots.
    pub(super) fn host(&self, of_edges: bool) -> Slots<'_> {
        Slots {
            per_destination: self.slots,
            sources: &self.rows.sources,
            relations: if of_edges { &self.rows.edges } else { &self.rows.numbers },
            open: &self.rows.open,
        }
    }

    /// Returns N, the number of destinations.
    pub fn destinations(&self) -> usize {
        self.destinations
    }

    /// Returns whether the row length was given by the caller.
    pub(super) fn is_fixed(&self) -> bool {
        self.fixed
    }

    /// Returns K, the row length.
    pub fn slots(&self) -> usize {
        self.slots
    }

    /// Gathers the edge vectors of all slots: [E, d] to [N, K, d]. Closed slots get the vector of
    /// the first edge, which has no effect.
    pub fn relations(&self, edges: Tensor<2>) -> Tensor<3> {
        self.gather(edges, &self.tensors().edge)
    }

    /// Gathers the source features of all slots: [M, h] to [N, K, h].
    pub fn sources(&self, nodes: Tensor<2>) -> Tensor<3> {
        self.gather(nodes, &self.tensors().source)
    }

    fn gather(&self, rows: Tensor<2>, index: &Tensor<1, Int>) -> Tensor<3> {
        let [count, width] = rows.dims();
        if self.slots == 0 || count == 0 {
            return Tensor::zeros([self.destinations, self.slots, width], &rows.device());
        }
        rows.select(0, index.clone()).reshape([self.destinations, self.slots, width])
    }

    /// Gathers the rows of all slots from a table of all pairs of sources and destinations: [M·N,
    /// w] to [N, K, w].
    pub(super) fn pairs(&self, table: Tensor<2>) -> Tensor<3> {
        self.gather(table, &self.tensors().pair)
    }

    /// Scatters [N, K, w] into a table of `sources` · N rows that is 0 elsewhere; the inverse of
    /// [`Self::pairs`]. Values of closed slots are added to the pair of their destination and the
    /// first source.
    pub(super) fn spread(&self, slots: Tensor<3>, sources: usize) -> Tensor<2> {
        let width = slots.dims()[2];
        let table = Tensor::zeros([sources * self.destinations, width], &slots.device());
        let rows = slots.reshape([self.destinations * self.slots, width]);
        table.select_assign(0, self.tensors().pair.clone(), rows, IndexingUpdateOp::Add)
    }

    /// Returns the offsets of scores, [N, 1, K].
    pub fn closed(&self) -> Tensor<3> {
        self.tensors().closed.clone()
    }

    /// Returns 1 for destinations with a source, else 0; [N, 1].
    pub(super) fn any(&self) -> Tensor<2> {
        self.any.clone()
    }
}

impl Rows {
    fn new(sources: Vec<u32>, edges: Vec<u32>, open: Vec<bool>) -> Self {
        let numbers = (0..open.len() as u32).collect();
        Self { sources, edges, numbers, open, tensors: OnceLock::new() }
    }
}
