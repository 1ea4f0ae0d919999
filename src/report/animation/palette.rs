//! The colours of an animation.

use std::collections::{BTreeMap, HashMap};

/// Red, green, blue.
pub(super) type Colour = [u8; 3];

/// The index that leaves a pixel as it was.
pub(super) const TRANSPARENT: u8 = 0;

/// A colour written as `#rrggbb`; black where it is not.
pub(super) fn rgb(hex: &str) -> Colour {
    let value = u32::from_str_radix(hex.trim_start_matches('#'), 16).unwrap_or(0);
    let [_, r, g, b] = value.to_be_bytes();
    [r, g, b]
}

/// Few colours that stand for many.
pub(super) struct Palette {
    colours: Vec<Colour>,
    /// The index of every colour that was asked for.
    known: HashMap<Colour, u8>,
}

/// Colours that one colour will stand for, with how much each weighs.
struct Cluster {
    members: Vec<(Colour, f64)>,
    /// The channel in which they differ most, where to cut there, and the sum of squared differences.
    axis: usize,
    cut: f64,
    spread: f64,
}

impl Cluster {
    fn new(members: Vec<(Colour, f64)>) -> Self {
        let total: f64 = members.iter().map(|m| m.1).sum();
        let mut found = (0, 0.0, 0.0);
        for axis in 0..3 {
            let value = |m: &(Colour, f64)| f64::from(m.0[axis]);
            let least = members.iter().map(value).fold(f64::INFINITY, f64::min);
            let most = members.iter().map(value).fold(0.0, f64::max);
            if least >= most {
                continue;
            }
            let mean = members.iter().map(|m| m.1 * value(m)).sum::<f64>() / total;
            let spread: f64 = members.iter().map(|m| m.1 * (value(m) - mean) * (value(m) - mean)).sum();
            if spread > found.2 {
                // Values are whole: with this cut there is something on both sides.
                found = (axis, mean.clamp(least, most - 0.5), spread);
            }
        }
        let (axis, cut, spread) = found;
        Self { members, axis, cut, spread }
    }

    /// The colour that weighs most: flat areas keep theirs exactly.
    fn colour(&self) -> Colour {
        let mut best = self.members[0];
        for member in &self.members {
            if member.1 > best.1 {
                best = *member;
            }
        }
        best.0
    }
}

impl Palette {
    /// At most `most` colours (at least 1, at most 255) for these, with how many pixels have each. Clusters are cut in two at their mean, the
    /// one with the greatest sum of squared differences first, until there are enough (a simple form of Wu's quantiser of 1991). A colour
    /// weighs as the root of its pixels, so that what is small and bright is not lost beside the ground.
    pub(super) fn new(counts: &BTreeMap<Colour, u64>, most: usize) -> Self {
        let members: Vec<(Colour, f64)> = counts.iter().map(|(c, n)| (*c, (*n as f64).sqrt())).collect();
        let mut clusters = if members.is_empty() { Vec::new() } else { vec![Cluster::new(members)] };
        while clusters.len() < most.clamp(1, 255) {
            // Of equal ones the first.
            let mut widest = 0;
            for (i, cluster) in clusters.iter().enumerate() {
                if cluster.spread > clusters[widest].spread {
                    widest = i;
                }
            }
            if clusters.get(widest).is_none_or(|c| c.spread <= 0.0) {
                break;
            }
            let Cluster { members, axis, cut, .. } = clusters.swap_remove(widest);
            let (low, high): (Vec<_>, Vec<_>) =
                members.into_iter().partition(|m| f64::from(m.0[axis]) <= cut);
            clusters.extend([low, high].map(Cluster::new));
        }
        let mut colours: Vec<Colour> = clusters.iter().map(Cluster::colour).collect();
        colours.sort_unstable();
        colours.dedup();
        Self { colours, known: HashMap::new() }
    }

    /// Red, green and blue of each index; that of the transparent one means nothing.
    pub(super) fn table(&self) -> Vec<u8> {
        std::iter::once(&[0, 0, 0]).chain(&self.colours).flatten().copied().collect()
    }

    /// The indices of the nearest colours.
    pub(super) fn indices(&mut self, pixels: &[Colour]) -> Vec<u8> {
        let mut indices = Vec::with_capacity(pixels.len());
        let mut before: Option<(Colour, u8)> = None;
        for &pixel in pixels {
            let index = match before {
                Some((same, index)) if same == pixel => index,
                _ => self.index(pixel),
            };
            indices.push(index);
            before = Some((pixel, index));
        }
        indices
    }

    fn index(&mut self, pixel: Colour) -> u8 {
        if let Some(&index) = self.known.get(&pixel) {
            return index;
        }
        // Green tells most to the eye, blue least.
        let far = |c: &Colour| -> u32 {
            let square = |k: usize| u32::from(c[k].abs_diff(pixel[k])) * u32::from(c[k].abs_diff(pixel[k]));
            3 * square(0) + 4 * square(1) + 2 * square(2)
        };
        let nearest = (0..self.colours.len()).min_by_key(|&i| far(&self.colours[i]));
        let index = nearest.map_or(TRANSPARENT, |i| i as u8 + 1);
        self.known.insert(pixel, index);
        index
    }
}
