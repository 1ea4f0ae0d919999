//! Bounds of kinematic feasibility (ReactSim-Bench, "Metric Computation Details").

/// Largest feasible magnitude of acceleration, m/s².
pub const MAX_ACCELERATION: f64 = 6.0;
/// Largest feasible magnitude of path curvature, 1/m.
pub const MAX_CURVATURE: f64 = 0.3;
