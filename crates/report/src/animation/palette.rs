//! The colours of an animation.

use std::collections::{BTreeMap, HashMap};

/// Red, green, blue.
pub(super) type Colour = [u8; 3];

/// Palette index that leaves a pixel unchanged.
pub(super) const TRANSPARENT: u8 = 0;

/// Parses a colour written as `#rrggbb`; black if malformed.
pub(super) fn rgb(hex: &str) -> Colour {
    let value = u32::from_str_radix(hex.trim_start_matches('#'), 16).unwrap_or(0);
    let [_, r, g, b] = value.to_be_bytes();
    [r, g, b]
}

/// Few colours that approximate many.
pub(super) struct Palette {
    colours: Vec<Colour>,
    /// Cached index of every colour looked up so far.
    known: HashMap<Colour, u8>,
}

/// Colours that share one palette colour.
struct Cluster {
    /// Colours with their weights.
    members: Vec<(Colour, f64)>,
    /// Channel with the largest spread.
    axis: usize,
    /// Value of that channel at which to split the cluster.
    cut: f64,
    /// Weighted sum of squared differences from the mean in that channel.
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
                // Values are integers: with this cut, neither side is empty.
                found = (axis, mean.clamp(least, most - 0.5), spread);
            }
        }
        let (axis, cut, spread) = found;
        Self { members, axis, cut, spread }
    }

    /// Returns the colour with the largest weight, so that flat areas keep their exact colour.
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
    /// Creates a palette of at most `most` colours (1 to 255) from the pixel counts of colours. Clusters
    /// are split at their mean, the one with the largest sum of squared differences first, until there
    /// are enough (a simple form of Wu's quantiser of 1991). The weight of a colour is the square root of
    /// its pixel count, so that small bright areas are not lost among large ones.
    pub(super) fn new(counts: &BTreeMap<Colour, u64>, most: usize) -> Self {
        let members: Vec<(Colour, f64)> = counts.iter().map(|(c, n)| (*c, (*n as f64).sqrt())).collect();
        let mut clusters = if members.is_empty() { Vec::new() } else { vec![Cluster::new(members)] };
        while clusters.len() < most.clamp(1, 255) {
            // Ties: the first one.
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

    /// Returns red, green and blue of each index; those of the transparent index are meaningless.
    pub(super) fn table(&self) -> Vec<u8> {
        std::iter::once(&[0, 0, 0]).chain(&self.colours).flatten().copied().collect()
    }

    /// Returns the indices of the nearest colours.
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
        // The eye is most sensitive to green and least to blue.
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
