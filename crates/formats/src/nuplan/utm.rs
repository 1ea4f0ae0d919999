//! Projection of WGS 84 degrees to metres of a northern UTM zone.
//!
//! Transverse Mercator projection by Krüger's series to the sixth order in the third flattening (Karney,
//! "Transverse Mercator with an accuracy of a few nanometers", J. Geodesy 85, 2011, equations 6 to 13 and
//! 35), with Clenshaw summation.

use reactsim_geometry::{Vec2, math};

/// Semi-major axis of WGS 84 in metres.
const SEMI_MAJOR_AXIS: f64 = 6_378_137.0;
/// Flattening of WGS 84.
const FLATTENING: f64 = 1.0 / 298.257_223_563;
/// Scale factor on the central meridian of a UTM zone.
const MERIDIAN_SCALE: f64 = 0.9996;
/// Easting of the central meridian in metres.
const FALSE_EASTING: f64 = 500_000.0;
/// Maximum distance in degrees of longitude from the central meridian; the half width of a zone is 3.
const MAX_LONGITUDE_OFFSET: f64 = 6.0;

/// A northern UTM zone.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Utm {
    /// Number of the zone, 1 to 60.
    zone: u8,
    /// Eccentricity.
    e: f64,
    /// Radius of the rectifying sphere times the scale factor, in metres.
    radius: f64,
    /// Coefficients of the Krüger series.
    alpha: [f64; 6],
}

impl Utm {
    /// Returns the zone of an EPSG code from 32601 to 32660; `None` for other codes.
    pub(super) fn of_epsg(code: i64) -> Option<Self> {
        let zone = u8::try_from(code.checked_sub(32_600)?).ok().filter(|z| (1..=60).contains(z))?;
        let n = FLATTENING / (2.0 - FLATTENING);
        let (n2, n3) = (n * n, n * n * n);
        let (n4, n5, n6) = (n2 * n2, n2 * n3, n3 * n3);
        Some(Self {
            zone,
            e: (FLATTENING * (2.0 - FLATTENING)).sqrt(),
            radius: MERIDIAN_SCALE * SEMI_MAJOR_AXIS / (1.0 + n) * (1.0 + n2 / 4.0 + n4 / 64.0 + n6 / 256.0),
            alpha: [
                n / 2.0 - 2.0 / 3.0 * n2 + 5.0 / 16.0 * n3 + 41.0 / 180.0 * n4 - 127.0 / 288.0 * n5
                    + 7891.0 / 37_800.0 * n6,
                13.0 / 48.0 * n2 - 3.0 / 5.0 * n3 + 557.0 / 1440.0 * n4 + 281.0 / 630.0 * n5
                    - 1_983_433.0 / 1_935_360.0 * n6,
                61.0 / 240.0 * n3 - 103.0 / 140.0 * n4
                    + 15_061.0 / 26_880.0 * n5
                    + 167_603.0 / 181_440.0 * n6,
                49_561.0 / 161_280.0 * n4 - 179.0 / 168.0 * n5 + 6_601_661.0 / 7_257_600.0 * n6,
                34_729.0 / 80_640.0 * n5 - 3_418_889.0 / 1_995_840.0 * n6,
                212_378_941.0 / 319_334_400.0 * n6,
            ],
        })
    }

    /// Projects a point in degrees to easting and northing in metres; `None` if it is not finite or outside
    /// the zone.
    pub(super) fn project(&self, longitude: f64, latitude: f64) -> Option<Vec2> {
        let east = longitude - (6.0 * f64::from(self.zone) - 183.0);
        if !(east.abs() <= MAX_LONGITUDE_OFFSET && (0.0..=84.0).contains(&latitude)) {
            return None;
        }
        let (sin_lat, cos_lat) = math::sin_cos(latitude.to_radians());
        let (sin_lon, cos_lon) = math::sin_cos(east.to_radians());
        // The tangent of the conformal latitude.
        let tau = sin_lat / cos_lat;
        let sigma = math::sinh(self.e * math::atanh(self.e * sin_lat));
        let conformal = tau * (1.0 + sigma * sigma).sqrt() - sigma / cos_lat;
        let xi = math::atan2(conformal, cos_lon);
        let eta = math::asinh(sin_lon / math::hypot(conformal, cos_lon));
        // Complex sum over j of alpha_j sin(2 j (xi + i eta)).
        let (sin_xi, cos_xi) = math::sin_cos(2.0 * xi);
        let (sinh_eta, cosh_eta) = (math::sinh(2.0 * eta), math::cosh(2.0 * eta));
        let twice_cos = (2.0 * cos_xi * cosh_eta, -2.0 * sin_xi * sinh_eta);
        let (mut b1, mut b2) = ((0.0, 0.0), (0.0, 0.0));
        for alpha in self.alpha.iter().rev() {
            let turned = times(twice_cos, b1);
            (b1, b2) = ((turned.0 - b2.0 + alpha, turned.1 - b2.1), b1);
        }
        let sum = times(b1, (sin_xi * cosh_eta, cos_xi * sinh_eta));
        Some(Vec2::new(FALSE_EASTING + self.radius * (eta + sum.1), self.radius * (xi + sum.0)))
    }
}

/// Multiplies two complex numbers (real, imaginary).
fn times(a: (f64, f64), b: (f64, f64)) -> (f64, f64) {
    (a.0 * b.0 - a.1 * b.1, a.0 * b.1 + a.1 * b.0)
}
