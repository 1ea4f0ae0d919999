//! Zip merging: where ways join at speed.

use super::super::following::Leader;
use super::super::network::Duty;
use super::{Sight, ZIP_FROM};

/// From so far before the place where ways join drivers fall in behind one another, metres.
const ZIP: f64 = 80.0;
/// Who has to give way does so to those who are less than this behind, metres; less so at low speeds.
const ZIP_BIAS: f64 = 6.0;
/// How hard they brake for it while there is time, and how much harder at the end, m/s².
const ZIP_BRAKING: f64 = 1.2;
const ZIP_URGENCY: f64 = 3.0;

impl Sight<'_> {
    /// Where ways join at speed, drivers fall in behind one another well before (zip merging): how hard to brake for those who join ahead,
    /// m/s². Nearer to the end of the way goes first; who has to give way must be some metres ahead to do so.
    pub(in super::super) fn falls_in(&self, me: usize) -> Option<f64> {
        let v = &self.vehicles[me];
        if v.speed < ZIP_FROM {
            return None;
        }
        let mut start = 0.0;
        let mut hardest: Option<f64> = None;
        for &w in &v.path {
            let way = &self.network.ways[w];
            if start - v.s > ZIP {
                break;
            }
            let mine = start + way.length - v.s;
            for c in way.conflicts.iter().filter(|c| c.joins) {
                let other_way = &self.network.ways[c.other];
                for o in self.lists.coming(c.other).iter().filter(|o| o.vehicle != me && !self.is_held(o)) {
                    let other = &self.vehicles[o.vehicle];
                    let theirs = other_way.length - o.at;
                    // The same for both of them, with the other sign: one of the two goes first.
                    let ahead = ZIP_BIAS.min(1.0 + 0.5 * v.speed.min(other.speed));
                    let bias = match c.duty {
                        Duty::GiveWay => ahead,
                        Duty::GoFirst => -ahead,
                        Duty::Equal if w < c.other => 0.1,
                        Duty::Equal => -0.1,
                    };
                    let near = o.at > c.theirs[0] - ZIP && other.speed > ZIP_FROM;
                    if !near || theirs >= mine + bias || v.path.contains(&other.path[0]) {
                        continue;
                    }
                    let gap = mine - theirs - 0.5 * (v.body.length + other.body.length);
                    let wished = v.driver.behind(v.speed, Leader { gap: gap.max(0.5), speed: other.speed });
                    // There is time until the ways are one.
                    let left = (start + c.mine[0] - v.s).max(0.0);
                    let bounded = wished.max(-ZIP_BRAKING - ZIP_URGENCY * (1.0 - left / ZIP).clamp(0.0, 1.0));
                    hardest = Some(hardest.map_or(bounded, |h: f64| h.min(bounded)));
                }
            }
            start += way.length;
        }
        hardest
    }
}
