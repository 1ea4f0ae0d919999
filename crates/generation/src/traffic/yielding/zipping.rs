//! Zip merging: lanes that join at speed.

use super::super::following::Leader;
use super::super::network::Duty;
use super::{Sight, ZIP_SPEED};

/// Distance before the joining point, metres, from which on drivers fall in behind one another.
const ZIP_DISTANCE: f64 = 80.0;
/// Distance, metres, within which a driver without right of way yields to vehicles behind; smaller at low
/// speeds.
const ZIP_BIAS: f64 = 6.0;
/// Maximum braking for merging while there is time, m/s².
const ZIP_BRAKING: f64 = 1.2;
/// Additional braking at the end of the lane, m/s².
const ZIP_URGENCY: f64 = 3.0;

impl Sight<'_> {
    /// Returns the acceleration, m/s², with which a driver falls in behind vehicles that join ahead. Where
    /// lanes join at speed, drivers do so well in advance (zip merging): the vehicle closer to the end of
    /// its lane goes first; a driver without right of way must be some metres ahead to do so.
    pub(in super::super) fn zip_acceleration(&self, me: usize) -> Option<f64> {
        let v = &self.vehicles[me];
        if v.speed < ZIP_SPEED {
            return None;
        }
        let mut start = 0.0;
        let mut hardest: Option<f64> = None;
        for &index in &v.path {
            let lane = &self.network.lanes[index];
            if start - v.s > ZIP_DISTANCE {
                break;
            }
            let mine = start + lane.length - v.s;
            for c in lane.conflicts.iter().filter(|c| c.joins) {
                let other_lane = &self.network.lanes[c.other];
                for o in
                    self.occupancy.approaching(c.other).iter().filter(|o| o.vehicle != me && !self.is_held(o))
                {
                    let other = &self.vehicles[o.vehicle];
                    let theirs = other_lane.length - o.at;
                    // Equal for both vehicles, with opposite signs: one of the two goes first.
                    let ahead = ZIP_BIAS.min(1.0 + 0.5 * v.speed.min(other.speed));
                    let bias = match c.duty {
                        Duty::GiveWay => ahead,
                        Duty::GoFirst => -ahead,
                        Duty::Equal if index < c.other => 0.1,
                        Duty::Equal => -0.1,
                    };
                    let near = o.at > c.theirs[0] - ZIP_DISTANCE && other.speed > ZIP_SPEED;
                    if !near || theirs >= mine + bias || v.path.contains(&other.path[0]) {
                        continue;
                    }
                    let gap = mine - theirs - 0.5 * (v.body.length + other.body.length);
                    let desired = v.driver.behind(v.speed, Leader { gap: gap.max(0.5), speed: other.speed });
                    // There is time until the lanes merge.
                    let left = (start + c.mine[0] - v.s).max(0.0);
                    let bounded =
                        desired.max(-ZIP_BRAKING - ZIP_URGENCY * (1.0 - left / ZIP_DISTANCE).clamp(0.0, 1.0));
                    hardest = Some(hardest.map_or(bounded, |h: f64| h.min(bounded)));
                }
            }
            start += lane.length;
        }
        hardest
    }
}
