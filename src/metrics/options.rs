//! The documented variants of the metrics.

/// Variants of the metric definitions, included in every result. The defaults are those of the benchmark.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Options {
    /// Corner rounding of the boxes: 0.7, or 0 for sharp boxes.
    pub corner_rounding: f64,
    /// Source of velocities.
    pub velocity_source: VelocitySource,
    /// Order of the fault rules.
    pub fault_order: FaultOrder,
    /// Whether vehicles that overlap the AV at the current frame have no collision event.
    pub exclude_initial_overlap: bool,
    /// Whether heading differences are wrapped for the time to collision.
    pub ttc_wrap_heading: bool,
    /// Source of the speed for the time to collision.
    pub ttc_speed: TtcSpeed,
    /// Whether the AV is a partner in agent-agent collisions.
    pub aa_include_av: bool,
    /// Whether objects of kind `other` are partners in agent-agent collisions.
    pub aa_include_other: bool,
    /// Whether the progress window has 11 increments (nuPlan's slice) instead of 10.
    pub dir_window_extra: bool,
    /// Choice among several connectors at a vehicle's position.
    pub dir_connector: DirConnector,
    /// Steps that make a vehicle a candidate for the driving direction.
    pub dir_candidate: DirCandidate,
    /// Method of assigning lanes.
    pub dir_tracking: DirTracking,
    /// Heading change from which the curvature is computed.
    pub curvature_yaw: CurvatureYaw,
    /// Whether the ADE includes the history, with zero error (WOSAC).
    pub ade_include_history: bool,
    /// Whether the ADE includes the AV (WOSAC).
    pub ade_include_av: bool,
    /// Whether the kinematic likelihood includes the AV.
    pub lik_include_av: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            corner_rounding: 0.7,
            velocity_source: VelocitySource::State,
            fault_order: FaultOrder::Paper,
            exclude_initial_overlap: false,
            ttc_wrap_heading: true,
            ttc_speed: TtcSpeed::State,
            aa_include_av: false,
            aa_include_other: false,
            dir_window_extra: false,
            dir_connector: DirConnector::First,
            dir_candidate: DirCandidate::Lane,
            dir_tracking: DirTracking::Auto,
            curvature_yaw: CurvatureYaw::Heading,
            ade_include_history: false,
            ade_include_av: false,
            lik_include_av: true,
        }
    }
}

/// Defines an enum of named choices with `ALL`, `name` and `from_name`.
macro_rules! choices {
    ($(#[$doc:meta])* $type:ident { $($(#[$item_doc:meta])* $item:ident = $name:literal),+ $(,)? }) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum $type { $($(#[$item_doc])* $item),+ }

        impl $type {
            /// All choices.
            pub const ALL: &'static [Self] = &[$(Self::$item),+];

            /// Returns the name used in files.
            pub const fn name(self) -> &'static str {
                match self { $(Self::$item => $name),+ }
            }

            /// Returns the choice with this name.
            pub fn from_name(name: &str) -> Option<Self> {
                Self::ALL.iter().copied().find(|c| c.name() == name)
            }
        }
    };
}

choices! {
    /// Source of velocities.
    VelocitySource {
        /// The velocity of the state if it has one, else position differences.
        State = "state",
        /// Always position differences.
        Diff = "diff",
    }
}

choices! {
    /// Order of the fault rules "AV behind" and "AV stopped".
    FaultOrder {
        /// Behind first, as in the paper's sentence.
        Paper = "paper",
        /// Stopped first, as in nuPlan.
        Nuplan = "nuplan",
    }
}

choices! {
    /// Source of the speed for the time to collision.
    TtcSpeed {
        /// The same speed as in all other metrics.
        State = "state",
        /// Central position differences (WOSAC); unknown at the last step.
        Central = "central",
    }
}

choices! {
    /// Choice among several connectors at a vehicle's position.
    DirConnector {
        /// The first of the list.
        First = "first",
        /// The one with the smallest heading error.
        MinHeading = "min_heading",
    }
}

choices! {
    /// Steps that make a vehicle a candidate for the driving direction.
    DirCandidate {
        /// Valid and on a lane.
        Lane = "lane",
        /// Also faster than 1 m/s.
        Moving = "moving",
    }
}

choices! {
    /// Method of assigning lanes.
    DirTracking {
        /// `pointwise` in maps without drivable polygons whose lanes are corridors around centre lines, else
        /// `route`.
        Auto = "auto",
        /// nuPlan's route: lanes are followed from pose to pose.
        Route = "route",
        /// Of all lanes that contain the point, the one with the smallest heading error.
        Pointwise = "pointwise",
    }
}

choices! {
    /// Heading change from which the curvature is computed.
    CurvatureYaw {
        /// Heading minus heading.
        Heading = "heading",
        /// Direction of the velocity minus heading (Waymax).
        Velocity = "velocity",
    }
}

/// The reason why an option cannot be set.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum OptionError {
    /// No option has this name.
    #[error("unknown metric option `{name}`, expected one of: {known}")]
    Unknown {
        /// The name.
        name: String,
        /// All names.
        known: String,
    },
    /// The option has no such value.
    #[error("metric option `{name}` is `{value}`, expected {expected}")]
    Value {
        /// The name.
        name: String,
        /// The value.
        value: String,
        /// The permitted values.
        expected: String,
    },
}

fn choice<T: Copy>(value: &str, all: &[T], name: impl Fn(T) -> &'static str) -> Result<T, String> {
    let found = all.iter().copied().find(|&c| name(c) == value);
    found.ok_or_else(|| all.iter().map(|&c| format!("`{}`", name(c))).collect::<Vec<_>>().join(" or "))
}

fn flag(value: &str) -> Result<bool, String> {
    match value {
        "true" => Ok(true),
        "false" => Ok(false),
        _ => Err("`true` or `false`".to_owned()),
    }
}

impl Options {
    /// Names of all options, in the order of [`Options::named`].
    pub const NAMES: &'static [&'static str] = &[
        "corner_rounding",
        "velocity_source",
        "fault_order",
        "exclude_initial_overlap",
        "ttc_wrap_heading",
        "ttc_speed",
        "aa_include_av",
        "aa_include_other",
        "dir_window_extra",
        "dir_connector",
        "dir_candidate",
        "dir_tracking",
        "curvature_yaw",
        "ade_include_history",
        "ade_include_av",
        "lik_include_av",
    ];

    /// Sets an option by name from the text of its value, such as `fault_order` and `nuplan`.
    ///
    /// # Errors
    /// [`OptionError`] names the option and its permitted values.
    pub fn set(&mut self, name: &str, value: &str) -> Result<(), OptionError> {
        let result = match name {
            "corner_rounding" => match value.parse::<f64>() {
                Ok(v) if (0.0..=1.0).contains(&v) => {
                    self.corner_rounding = v;
                    Ok(())
                }
                _ => Err("a number from 0 to 1, such as 0.7".to_owned()),
            },
            "velocity_source" => {
                choice(value, VelocitySource::ALL, VelocitySource::name).map(|v| self.velocity_source = v)
            }
            "fault_order" => choice(value, FaultOrder::ALL, FaultOrder::name).map(|v| self.fault_order = v),
            "exclude_initial_overlap" => flag(value).map(|v| self.exclude_initial_overlap = v),
            "ttc_wrap_heading" => flag(value).map(|v| self.ttc_wrap_heading = v),
            "ttc_speed" => choice(value, TtcSpeed::ALL, TtcSpeed::name).map(|v| self.ttc_speed = v),
            "aa_include_av" => flag(value).map(|v| self.aa_include_av = v),
            "aa_include_other" => flag(value).map(|v| self.aa_include_other = v),
            "dir_window_extra" => match value {
                "0" | "1" => {
                    self.dir_window_extra = value == "1";
                    Ok(())
                }
                _ => Err("`0` or `1`".to_owned()),
            },
            "dir_connector" => {
                choice(value, DirConnector::ALL, DirConnector::name).map(|v| self.dir_connector = v)
            }
            "dir_candidate" => {
                choice(value, DirCandidate::ALL, DirCandidate::name).map(|v| self.dir_candidate = v)
            }
            "dir_tracking" => {
                choice(value, DirTracking::ALL, DirTracking::name).map(|v| self.dir_tracking = v)
            }
            "curvature_yaw" => {
                choice(value, CurvatureYaw::ALL, CurvatureYaw::name).map(|v| self.curvature_yaw = v)
            }
            "ade_include_history" => flag(value).map(|v| self.ade_include_history = v),
            "ade_include_av" => flag(value).map(|v| self.ade_include_av = v),
            "lik_include_av" => flag(value).map(|v| self.lik_include_av = v),
            _ => {
                return Err(OptionError::Unknown { name: name.to_owned(), known: Self::NAMES.join(", ") });
            }
        };
        result.map_err(|expected| OptionError::Value {
            name: name.to_owned(),
            value: value.to_owned(),
            expected,
        })
    }

    /// Returns every option with the text of its value, for result files.
    pub fn named(&self) -> Vec<(&'static str, String)> {
        let values = [
            self.corner_rounding.to_string(),
            self.velocity_source.name().to_owned(),
            self.fault_order.name().to_owned(),
            self.exclude_initial_overlap.to_string(),
            self.ttc_wrap_heading.to_string(),
            self.ttc_speed.name().to_owned(),
            self.aa_include_av.to_string(),
            self.aa_include_other.to_string(),
            u8::from(self.dir_window_extra).to_string(),
            self.dir_connector.name().to_owned(),
            self.dir_candidate.name().to_owned(),
            self.dir_tracking.name().to_owned(),
            self.curvature_yaw.name().to_owned(),
            self.ade_include_history.to_string(),
            self.ade_include_av.to_string(),
            self.lik_include_av.to_string(),
        ];
        Self::NAMES.iter().copied().zip(values).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_option_round_trips() {
        let mut set = Options::default();
        for (name, value) in Options::default().named() {
            set.set(name, &value).unwrap();
        }
        assert_eq!(set, Options::default());
    }

    #[test]
    fn errors_name_the_option() {
        let mut options = Options::default();
        let unknown = options.set("corner", "1").unwrap_err().to_string();
        assert!(unknown.contains("unknown metric option `corner`") && unknown.contains("corner_rounding"));
        let value = options.set("fault_order", "mine").unwrap_err().to_string();
        assert_eq!(value, "metric option `fault_order` is `mine`, expected `paper` or `nuplan`");
        for (name, bad) in [("corner_rounding", "nan"), ("aa_include_av", "1"), ("dir_window_extra", "2")] {
            assert!(options.set(name, bad).is_err(), "{name} {bad}");
        }
    }
}
