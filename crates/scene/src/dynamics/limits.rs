//! Bounds of kinematic feasibility (ReactSim-Bench, "Metric Computation Details"), and of standstill.

/// Largest feasible magnitude of acceleration, m/s².
pub const MAX_ACCELERATION: f64 = 6.0;
/// Largest feasible magnitude of path curvature, 1/m.
pub const MAX_CURVATURE: f64 = 0.3;
/// Speed in m/s below which an agent is at standstill: recorded positions of stationary agents jitter by a
/// centimetre or two between frames.
pub const STANDSTILL_SPEED: f64 = 0.1;
/// Displacement in metres over a whole log below which an agent is parked: recorded positions jitter.
pub const PARKED_DISPLACEMENT: f64 = 0.5;
