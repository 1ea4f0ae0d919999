//! Sizes of vehicles and bicycles, and their turning radius, rear axle and acceleration.
//!
//! The mixture is fitted to the boxes in the Waymo Open Motion Dataset (the train split kept outside this
//! repository: 196 scenarios, 10 894 vehicles and 62 cyclists, all that were recorded): lengths of vehicles
//! 4.26, 4.46, 4.62, 4.83, 5.31, 5.74 and 8.05 m at the quantiles 5, 25, 50, 75, 90, 95 and 99 %, widths
//! 1.94, 2.01, 2.06, 2.14, 2.30, 2.41 and 2.93 m; bicycles with their riders 1.62, 1.83 and 2.06 m by 0.75,
//! 0.84 and 0.93 m at 5, 50 and 95 %. Recorded boxes include mirrors, so they are wider than in data
//! sheets. Within a class the width follows the length, as in the recording (2.01 m at 4.4 m, 2.20 m at
//! 5.05 m, 2.40 m at 5.8 m). No vehicle is articulated.
//!
//! Turning radii follow the AASHTO design vehicles (*A Policy on Geometric Design of Highways and Streets*,
//! 2011: centreline turning radius, at the front axle, of passenger car 6.4 m, single-unit truck 11.6 m,
//! city bus 11.5 m). Here they are radii of box centres, hence somewhat smaller for cars and trucks.
//! According to Bokare & Maurya (*Acceleration-deceleration behaviour of various vehicle types*,
//! Transportation Research Procedia 25, 2017: trucks at most 1.0 m/s², cars 2.2 to 2.9), trucks accelerate
//! at most about half as hard as cars; the factors of vans and buses are chosen.

use reactsim_rollout::Stream;
use reactsim_scene::dynamics::REAR_AXLE;

use crate::Draw;

/// Class of vehicle.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Class {
    /// Small cars to large saloons.
    Car,
    /// Sport utility vehicles and minivans.
    Suv,
    /// Pickups.
    Pickup,
    /// Delivery vans.
    Van,
    /// Rigid trucks.
    Truck,
    /// City buses and coaches.
    Bus,
    /// A bicycle with its rider.
    Bicycle,
}

/// Class and dimensions of a vehicle, drawn once.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Size {
    /// Vehicle class.
    pub class: Class,
    /// Extent along the heading, metres.
    pub length: f64,
    /// Extent across the heading, metres.
    pub width: f64,
}

/// Distribution of sizes within a class: lengths are normal within bounds, the width grows with the length.
struct Shape {
    class: Class,
    /// Share among motor vehicles.
    share: f64,
    /// Mean, standard deviation, minimum and maximum, metres.
    length: [f64; 4],
    /// Width at the mean length, growth per metre of length, and standard deviation, metres.
    width: [f64; 3],
}

const SHAPES: [Shape; 7] = [
    Shape { class: Class::Car, share: 0.60, length: [4.51, 0.17, 3.6, 5.1], width: [2.025, 0.22, 0.04] },
    Shape { class: Class::Suv, share: 0.28, length: [4.77, 0.2, 4.2, 5.3], width: [2.11, 0.24, 0.045] },
    Shape { class: Class::Pickup, share: 0.067, length: [5.4, 0.25, 4.8, 6.1], width: [2.31, 0.2, 0.06] },
    Shape { class: Class::Van, share: 0.035, length: [5.72, 0.38, 4.9, 6.8], width: [2.38, 0.2, 0.06] },
    Shape { class: Class::Truck, share: 0.014, length: [7.9, 1.0, 6.4, 10.5], width: [2.9, 0.08, 0.09] },
    Shape { class: Class::Bus, share: 0.004, length: [11.6, 1.1, 8.5, 13.2], width: [3.12, 0.03, 0.06] },
    Shape { class: Class::Bicycle, share: 0.0, length: [1.83, 0.13, 1.5, 2.1], width: [0.84, 0.1, 0.05] },
];

impl Size {
    /// Draws a motor vehicle of moving traffic.
    pub fn draw(rng: &mut Stream) -> Self {
        let shares: Vec<f64> = SHAPES.iter().map(|s| s.share).collect();
        let which = rng.weighted(&shares);
        Self::of(SHAPES[which].class, rng)
    }

    /// Draws a bicycle with its rider.
    pub fn bicycle(rng: &mut Stream) -> Self {
        Self::of(Class::Bicycle, rng)
    }

    /// Draws a vehicle of this class.
    pub fn of(class: Class, rng: &mut Stream) -> Self {
        let shape = &SHAPES[class as usize];
        let [mean, deviation, low, high] = shape.length;
        let length = rng.normal_within(mean, deviation, low, high);
        let [at_mean, growth, scatter] = shape.width;
        let width = at_mean + growth * (length - mean) + scatter * rng.normal().clamp(-2.5, 2.5);
        Self { class, length, width }
    }

    /// Returns the distance of the rear axle behind the box centre, metres.
    pub fn rear_axle(&self) -> f64 {
        REAR_AXLE * self.length
    }

    /// Returns the minimum turning radius of the box centre, metres.
    pub fn turning_radius(&self) -> f64 {
        match self.class {
            Class::Car => 5.8,
            Class::Suv => 6.1,
            Class::Pickup | Class::Van => 6.9,
            Class::Truck => 11.0,
            Class::Bus => 11.5,
            Class::Bicycle => 2.0,
        }
    }

    /// Returns the comfortable and the maximum acceleration as a share of that of a car.
    pub fn acceleration_factor(&self) -> f64 {
        match self.class {
            Class::Car | Class::Suv => 1.0,
            Class::Pickup => 0.95,
            Class::Van => 0.85,
            Class::Truck => 0.55,
            Class::Bus => 0.6,
            Class::Bicycle => 0.5,
        }
    }
}

#[cfg(test)]
mod tests {
    use reactsim_rollout::{Purpose, stream};

    use super::*;

    fn quantiles(mut values: Vec<f64>) -> [f64; 7] {
        values.sort_by(f64::total_cmp);
        [0.05, 0.25, 0.5, 0.75, 0.9, 0.95, 0.99].map(|q| values[(values.len() as f64 * q) as usize])
    }

    fn close(found: [f64; 7], recorded: [f64; 7], tolerance: [f64; 7]) {
        for ((f, r), t) in found.iter().zip(recorded).zip(tolerance) {
            assert!((f - r).abs() <= t, "found {found:.2?}, recorded {recorded:?}");
        }
    }

    #[test]
    fn quantiles_are_those_of_recordings() {
        let mut rng = stream(0, "fleet", 0, Purpose::Traffic);
        let sizes: Vec<Size> = (0..40_000).map(|_| Size::draw(&mut rng)).collect();
        close(
            quantiles(sizes.iter().map(|s| s.length).collect()),
            [4.26, 4.46, 4.62, 4.83, 5.31, 5.74, 8.05],
            [0.06, 0.06, 0.06, 0.06, 0.1, 0.12, 0.5],
        );
        close(
            quantiles(sizes.iter().map(|s| s.width).collect()),
            [1.94, 2.01, 2.06, 2.14, 2.30, 2.41, 2.93],
            [0.03, 0.03, 0.03, 0.03, 0.05, 0.05, 0.12],
        );
        let rides: Vec<Size> = (0..4000).map(|_| Size::bicycle(&mut rng)).collect();
        let middle = quantiles(rides.iter().map(|s| s.length).collect())[2];
        assert!((middle - 1.83).abs() < 0.03, "{middle}");
    }

    #[test]
    fn every_shape_stands_at_its_class() {
        for (i, shape) in SHAPES.iter().enumerate() {
            assert_eq!(shape.class as usize, i);
        }
        let total: f64 = SHAPES.iter().map(|s| s.share).sum();
        assert!((total - 1.0).abs() < 1e-9);
    }

    #[test]
    fn long_vehicles_turn_wide_and_start_slowly() {
        let mut rng = stream(0, "fleet", 1, Purpose::Traffic);
        let (car, bus) = (Size::of(Class::Car, &mut rng), Size::of(Class::Bus, &mut rng));
        assert!(bus.turning_radius() > car.turning_radius());
        assert!(bus.acceleration_factor() < car.acceleration_factor());
        assert!(bus.rear_axle() > 2.0 * car.rear_axle());
    }
}
