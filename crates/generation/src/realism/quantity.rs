//! Measured quantities and their bins.

use super::Bins;

/// Description of a quantity, needed to read its figures.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Spec {
    /// Name in files.
    pub id: &'static str,
    /// Name for display.
    pub title: &'static str,
    /// Unit; empty for counts and shares.
    pub unit: &'static str,
    /// Definition of one value.
    pub of: &'static str,
    /// Bins of the histogram.
    pub bins: Bins,
}

/// A driving statistic; [`Quantity::spec`] defines it exactly. The order is that of tables.
///
/// Quantities with one value per scenario have few bins: the divergence of two samples of `n` values from
/// one distribution in `k` bins is about `(k - 1) / (2.8 n)`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Quantity {
    /// Speed of moving vehicles.
    Speed,
    /// Acceleration along the heading.
    Acceleration,
    /// Yaw rate.
    YawRate,
    /// Gap to the leader in the lane.
    Headway,
    /// Time gap to the leader.
    TimeGap,
    /// Smallest time to collision with a leader.
    MinTtc,
    /// Agents near the AV.
    AgentsNear,
    /// Vehicles near the AV.
    VehiclesNear,
    /// Pedestrians near the AV.
    PedestriansNear,
    /// Cyclists near the AV.
    CyclistsNear,
    /// Share of stopped vehicles.
    Stopped,
    /// Share of parked vehicles.
    Parked,
    /// Share of turning vehicles.
    Turning,
    /// Lane changes per kilometre.
    LaneChanges,
    /// Offset from the lane's centre.
    LaneOffset,
    /// Distance driven by the AV.
    AvDistance,
    /// Jerk along the heading.
    Jerk,
    /// Curvature of the path.
    Curvature,
    /// Acceleration across the heading.
    LateralAcceleration,
    /// Gap between standing vehicles in a queue.
    StandstillGap,
    /// Share of vehicles that never move.
    NeverMoving,
    /// Speed of unhindered vehicles divided by the speed limit.
    FreeSpeed,
    /// Speed of the AV.
    AvSpeed,
    /// Number of agents in the scenario.
    Agents,
    /// Speed of pedestrians.
    PedestrianSpeed,
    /// Speed of cyclists.
    CyclistSpeed,
    /// Length of vehicles.
    VehicleLength,
    /// Width of vehicles.
    VehicleWidth,
}

use Quantity as Q;

const fn bins(start: f64, width: f64, count: usize) -> Bins {
    Bins { start, width, count }
}

impl Quantity {
    /// All quantities in order: first those by which a set is judged.
    pub const ALL: [Self; 28] = [
        Q::Speed,
        Q::Acceleration,
        Q::YawRate,
        Q::Headway,
        Q::TimeGap,
        Q::MinTtc,
        Q::AgentsNear,
        Q::VehiclesNear,
        Q::PedestriansNear,
        Q::CyclistsNear,
        Q::Stopped,
        Q::Parked,
        Q::Turning,
        Q::LaneChanges,
        Q::LaneOffset,
        Q::AvDistance,
        Q::Jerk,
        Q::Curvature,
        Q::LateralAcceleration,
        Q::StandstillGap,
        Q::NeverMoving,
        Q::FreeSpeed,
        Q::AvSpeed,
        Q::Agents,
        Q::PedestrianSpeed,
        Q::CyclistSpeed,
        Q::VehicleLength,
        Q::VehicleWidth,
    ];

    /// Whether sets are judged by this quantity; the others show further differences.
    pub fn decides(self) -> bool {
        self <= Q::AvDistance
    }

    /// Returns its index in [`Quantity::ALL`].
    pub(super) fn index(self) -> usize {
        self as usize
    }

    /// Returns its description.
    #[rustfmt::skip]
    pub const fn spec(self) -> Spec {
        let (id, title, unit, of, bins) = match self {
            Q::Speed => ("speed", "Speed", "m/s", "moving vehicle, every 0.5 s", bins(0.0, 2.0, 16)),
            Q::Acceleration => ("acceleration", "Acceleration", "m/s²",
                "moving vehicle, every 0.5 s, along its heading", bins(-4.25, 0.5, 17)),
            Q::YawRate => ("yaw-rate", "Yaw rate", "rad/s",
                "vehicle faster than 1 m/s, every 0.5 s", bins(-0.525, 0.05, 21)),
            Q::Headway => ("headway", "Gap to the leader", "m",
                "moving vehicle with a leader within 60 m, every 0.5 s, bumper to bumper",
                bins(0.0, 4.0, 15)),
            Q::TimeGap => ("time-gap", "Time gap", "s",
                "the same, faster than 2 m/s: gap over own speed", bins(0.0, 0.5, 20)),
            Q::MinTtc => ("min-ttc", "Smallest TTC", "s",
                "vehicle that follows, over the window, to its leaders; 10 s where it is never smaller",
                bins(0.0, 1.0, 11)),
            Q::AgentsNear => ("agents-near", "Agents near the AV", "",
                "scenario: within 50 m at the current frame", bins(0.0, 8.0, 8)),
            Q::VehiclesNear => ("vehicles-near", "Vehicles near the AV", "",
                "scenario: within 50 m at the current frame", bins(0.0, 6.0, 8)),
            Q::PedestriansNear => ("pedestrians-near", "Pedestrians near the AV", "",
                "scenario: within 50 m at the current frame", bins(0.0, 4.0, 5)),
            Q::CyclistsNear => ("cyclists-near", "Cyclists near the AV", "",
                "scenario: within 50 m at the current frame", bins(0.0, 1.0, 5)),
            Q::Stopped => ("stopped", "Share stopped", "",
                "scenario: share of the vehicles slower than 0.5 m/s at the current frame",
                bins(0.0, 0.2, 5)),
            Q::Parked => ("parked", "Share parked", "",
                "scenario: share of the vehicles that never move and stand in no lane", bins(0.0, 0.2, 5)),
            Q::Turning => ("turning", "Share turning", "",
                "scenario: share of the vehicles driving 5 m or more that turn by more than 30°",
                bins(0.0, 0.2, 5)),
            Q::LaneChanges => ("lane-changes", "Lane changes", "1/km",
                "scenario with 200 m or more driven in lanes: changes per kilometre", bins(0.0, 1.0, 4)),
            Q::LaneOffset => ("lane-offset", "Offset in the lane", "m",
                "vehicle faster than 2 m/s in a lane that is clear, every 0.5 s, left positive",
                bins(-1.7, 0.2, 17)),
            Q::AvDistance => ("av-distance", "Way of the AV in 8 s", "m", "scenario", bins(0.0, 20.0, 8)),
            Q::Jerk => ("jerk", "Jerk", "m/s³",
                "moving vehicle, every 0.5 s, over a second", bins(-3.25, 0.5, 13)),
            Q::Curvature => ("curvature", "Curvature", "1/m",
                "vehicle faster than 2 m/s, every 0.5 s", bins(-0.21, 0.02, 21)),
            Q::LateralAcceleration => ("lateral-acceleration", "Lateral acceleration", "m/s²",
                "vehicle faster than 1 m/s, every 0.5 s", bins(-3.75, 0.5, 15)),
            Q::StandstillGap => ("standstill-gap", "Gap at standstill", "m",
                "vehicle standing in a lane behind one that stands, at the current frame", bins(0.0, 1.5, 6)),
            Q::NeverMoving => ("never-moving", "Share never moving", "",
                "scenario: share of the vehicles that stay within 1 m, in lanes or beside them",
                bins(0.0, 0.2, 5)),
            Q::FreeSpeed => ("free-speed", "Speed over the limit", "",
                "vehicle faster than 2 m/s, every 0.5 s, straight on, \
                 nobody ahead for 4 s: speed divided by the limit", bins(0.0, 0.1, 16)),
            Q::AvSpeed => ("av-speed", "Speed of the AV", "m/s",
                "scenario: at the current frame", bins(0.0, 3.0, 8)),
            Q::Agents => ("agents", "Agents", "",
                "scenario: that take part, without the AV", bins(0.0, 8.0, 8)),
            Q::PedestrianSpeed => ("pedestrian-speed", "Speed of pedestrians", "m/s",
                "pedestrian, every 0.5 s", bins(0.0, 0.25, 12)),
            Q::CyclistSpeed => ("cyclist-speed", "Speed of cyclists", "m/s",
                "cyclist, every 0.5 s", bins(0.0, 3.0, 3)),
            Q::VehicleLength => ("vehicle-length", "Length of vehicles", "m",
                "vehicle but the AV", bins(2.0, 0.5, 16)),
            Q::VehicleWidth => ("vehicle-width", "Width of vehicles", "m",
                "vehicle but the AV", bins(1.2, 0.1, 18)),
        };
        Spec { id, title, unit, of, bins }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_list_is_in_order_and_names_are_unique() {
        for (i, quantity) in Quantity::ALL.into_iter().enumerate() {
            assert_eq!(quantity.index(), i);
            let same = Quantity::ALL.iter().filter(|q| q.spec().id == quantity.spec().id);
            assert_eq!(same.count(), 1);
        }
    }
}
