//! The documented variants of the metrics.

/// Defines [`Options`]: each line gives documentation, field, type, default and reading of one option.
macro_rules! options {
    ($($(#[doc = $doc:literal])+ $field:ident: $type:ty = $default:expr, $form:ident;)+) => {
        /// Variants of the metric definitions, included in every result. The defaults are those of the
        /// benchmark.
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub struct Options { $($(#[doc = $doc])+ pub $field: $type),+ }

        impl Default for Options {
            fn default() -> Self {
                Self { $($field: $default),+ }
            }
        }

        impl Options {
            /// Names of all options, in the order of [`Options::named`].
            pub const NAMES: &'static [&'static str] = &[$(stringify!($field)),+];

            /// Returns the descriptions of all options, in the order of [`Options::named`].
            pub fn descriptions() -> Vec<OptionDescription> {
                vec![$(OptionDescription {
                    name: stringify!($field),
                    about: concat!($($doc),+).trim(),
                    values: $form::values(),
                    default: $form::text($default),
                }),+]
            }

            /// Sets an option by name from the text of its value, such as `fault_order` and `nuplan`. An
            /// option of an earlier version can only have the value that the present definitions have.
            ///
            /// # Errors
            /// [`OptionError`] names the option and its permitted values.
            pub fn set(&mut self, name: &str, value: &str) -> Result<(), OptionError> {
                if let Some((name, only)) = REMOVED.into_iter().find(|(removed, _)| *removed == name) {
                    let refused = || OptionError::Removed { name, value: value.to_owned(), only };
                    return if value == only { Ok(()) } else { Err(refused()) };
                }
                let result = match name {
                    $(stringify!($field) => $form::read(value).map(|v| self.$field = v),)+
                    _ => {
                        let known = Self::NAMES.join(", ");
                        return Err(OptionError::Unknown { name: name.to_owned(), known });
                    }
                };
                result.map_err(|expected| OptionError::Value {
                    name: name.to_owned(),
                    value: value.to_owned(),
                    expected,
                })
            }

            /// Returns whether only earlier versions have the option, and the value is the one that the
            /// present definitions have.
            pub fn is_obsolete(name: &str, value: &str) -> bool {
                REMOVED.contains(&(name, value))
            }

            /// Returns every option with the text of its value, for result files.
            pub fn named(&self) -> Vec<(&'static str, String)> {
                vec![$((stringify!($field), $form::text(self.$field))),+]
            }
        }
    };
}

/// Description of an option.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct OptionDescription {
    /// Name, as `--metric-option` takes it.
    pub name: &'static str,
    /// Meaning of the option.
    pub about: &'static str,
    /// Permitted values.
    pub values: String,
    /// Default value, that of the benchmark.
    pub default: String,
}

options! {
    /// Corner rounding of the boxes: 0.7, or 0 for sharp boxes.
    corner_rounding: f64 = 0.7, rounding;
    /// Source of velocities.
    velocity_source: VelocitySource = VelocitySource::State, VelocitySource;
    /// Order of the fault rules.
    fault_order: FaultOrder = FaultOrder::Paper, FaultOrder;
    /// Whether pairs that overlap at the first frame of both, such as a tractor and its trailer, are left out
    /// of collisions with the AV, risky approaches and agent-agent collisions.
    exclude_initial_overlap: bool = false, flag;
    /// Whether heading differences are wrapped for the time to collision.
    ttc_wrap_heading: bool = true, flag;
    /// Whether the AV is a partner in agent-agent collisions.
    aa_include_av: bool = false, flag;
    /// Whether vehicles are off the road with any corner of their box, instead of the centre.
    offroad_corners: bool = false, flag;
    /// Whether the progress window has 11 increments (nuPlan's slice) instead of 10.
    dir_window_extra: bool = false, digit;
    /// Choice among several connectors at a vehicle's position.
    dir_connector: DirConnector = DirConnector::First, DirConnector;
    /// Steps that make a vehicle a candidate for the driving direction.
    dir_candidate: DirCandidate = DirCandidate::Lane, DirCandidate;
    /// Method of assigning lanes.
    dir_tracking: DirTracking = DirTracking::Auto, DirTracking;
    /// Heading change from which the curvature is computed.
    curvature_yaw: CurvatureYaw = CurvatureYaw::Heading, CurvatureYaw;
    /// Whether the ADE includes the history, with zero error (WOSAC).
    ade_include_history: bool = false, flag;
    /// Whether the kinematic likelihood includes the AV.
    lik_include_av: bool = true, flag;
}

/// Options of earlier versions, with the value that the present definitions have. Files name them.
const REMOVED: [(&str, &str); 4] = [
    ("aa_include_other", "false"),
    ("ade_include_av", "false"),
    ("av_navsim", "false"),
    ("ttc_speed", "state"),
];

/// Text form of the corner rounding.
mod rounding {
    pub(super) fn read(value: &str) -> Result<f64, String> {
        let number = value.parse().ok().filter(|v| (0.0..=1.0).contains(v));
        number.ok_or_else(|| "a number from 0 to 1, such as 0.7".to_owned())
    }

    pub(super) fn values() -> String {
        "0 to 1".to_owned()
    }

    pub(super) fn text(value: f64) -> String {
        value.to_string()
    }
}

/// Text form `true` or `false`.
mod flag {
    pub(super) fn read(value: &str) -> Result<bool, String> {
        value.parse().map_err(|_| "`true` or `false`".to_owned())
    }

    pub(super) fn values() -> String {
        "true, false".to_owned()
    }

    pub(super) fn text(value: bool) -> String {
        value.to_string()
    }
}

/// Text form `1` or `0`.
mod digit {
    pub(super) fn read(value: &str) -> Result<bool, String> {
        match value {
            "0" => Ok(false),
            "1" => Ok(true),
            _ => Err("`0` or `1`".to_owned()),
        }
    }

    pub(super) fn values() -> String {
        "0, 1".to_owned()
    }

    pub(super) fn text(value: bool) -> String {
        u8::from(value).to_string()
    }
}

/// Defines an enum of named choices with `ALL`, `name` and `from_name`.
macro_rules! choices {
    ($(#[$doc:meta])* $type:ident { $($(#[$item_doc:meta])* $item:ident = $name:literal),+ $(,)? }) => {
        reactsim_scene::named_enum! {
            name, from_name;
            $(#[$doc])*
            #[derive(Clone, Copy, Debug, PartialEq, Eq)]
            pub enum $type { $($(#[$item_doc])* $item = $name),+ }
        }

        impl $type {
            fn read(value: &str) -> Result<Self, String> {
                let known = || Self::ALL.iter().map(|c| format!("`{}`", c.name())).collect::<Vec<_>>();
                Self::from_name(value).ok_or_else(|| known().join(" or "))
            }

            fn values() -> String {
                Self::ALL.iter().map(|c| c.name()).collect::<Vec<_>>().join(", ")
            }

            fn text(self) -> String {
                self.name().to_owned()
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
    /// Only an earlier version of the program has the option.
    #[error("metric option `{name}` is `{value}`: this version has no such option, and computes `{only}`")]
    Removed {
        /// The name.
        name: &'static str,
        /// The value.
        value: String,
        /// The value that the present definitions have.
        only: &'static str,
    },
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
    fn descriptions_state_values_and_defaults() {
        let all = Options::descriptions();
        assert_eq!(all.iter().map(|d| d.name).collect::<Vec<_>>(), Options::NAMES);
        for (option, (name, default)) in all.iter().zip(Options::default().named()) {
            assert_eq!(option.default, default, "{name}");
            assert!(option.about.ends_with('.'), "{option:?}");
            // Values are listed one by one, or as a range.
            for value in option.values.split(", ").flat_map(|text| text.split(" to ")) {
                Options::default().set(name, value).unwrap();
            }
        }
    }

    #[test]
    fn errors_name_the_option() {
        let mut options = Options::default();
        let unknown = options.set("corner", "1").unwrap_err().to_string();
        assert!(unknown.contains("unknown metric option `corner`") && unknown.contains("corner_rounding"));
        let value = options.set("fault_order", "mine").unwrap_err().to_string();
        assert_eq!(value, "metric option `fault_order` is `mine`, expected `paper` or `nuplan`");
        let removed = options.set("ttc_speed", "central").unwrap_err().to_string();
        assert!(
            removed.starts_with("metric option `ttc_speed` is `central`: this version has no"),
            "{removed}"
        );
        options.set("ttc_speed", "state").unwrap();
        for (name, bad) in [("corner_rounding", "nan"), ("aa_include_av", "1"), ("dir_window_extra", "2")] {
            assert!(options.set(name, bad).is_err(), "{name} {bad}");
        }
    }
}
