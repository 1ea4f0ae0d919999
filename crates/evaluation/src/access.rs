//! Knowledge of simulators beyond their observations.

use serde::{Deserialize, Serialize};

/// Knowledge of a simulator beyond its observations. Every table marks it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Access {
    /// None: it runs in this program and receives observations only.
    Blind,
    /// An external process that receives observations only. It could read the disk.
    BlindByMessage,
    /// An external process that also receives ids and world coordinates.
    Ids,
    /// The logged future.
    Oracle,
}

impl Access {
    /// All kinds that have a mark.
    pub const MARKED: [Self; 3] = [Self::Oracle, Self::BlindByMessage, Self::Ids];

    /// Returns the mark behind the name of a simulator; empty for none.
    pub const fn mark(self) -> &'static str {
        match self {
            Self::Blind => "",
            Self::BlindByMessage => "‡",
            Self::Ids => "§",
            Self::Oracle => "†",
        }
    }

    /// Returns the explanation of the mark.
    pub const fn meaning(self) -> &'static str {
        match self {
            Self::Blind => "receives observations only",
            Self::BlindByMessage => "is an external process, blind by message: it receives observations only",
            Self::Ids => "is an external process that receives ids and world coordinates, too",
            Self::Oracle => "is shown the log's future",
        }
    }
}
