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

/// The marks of a simulator in tables.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct TableMarks {
    /// Its knowledge beyond its observations.
    pub access: Access,
    /// Whether the user allowed motion in its rollouts that fails a check.
    pub is_allowed: bool,
}

/// A mark behind the name of a simulator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mark {
    /// Of its knowledge.
    Access(Access),
    /// Of motion that fails a check and was allowed.
    Allowed,
}

impl Mark {
    /// All marks.
    pub const ALL: [Self; 4] = [
        Self::Access(Access::Oracle),
        Self::Access(Access::BlindByMessage),
        Self::Access(Access::Ids),
        Self::Allowed,
    ];

    /// Returns the sign.
    pub const fn sign(self) -> &'static str {
        match self {
            Self::Access(access) => access.mark(),
            Self::Allowed => "¶",
        }
    }

    /// Returns the explanation.
    pub const fn meaning(self) -> &'static str {
        match self {
            Self::Access(access) => access.meaning(),
            Self::Allowed => "has rollouts whose motion fails a check that was allowed",
        }
    }
}

impl TableMarks {
    /// Returns whether the simulator is shown the log's future.
    pub fn is_oracle(self) -> bool {
        self.access == Access::Oracle
    }

    /// Returns its marks.
    pub fn marks(self) -> impl Iterator<Item = Mark> {
        Mark::ALL.into_iter().filter(move |mark| match mark {
            Mark::Access(access) => *access == self.access,
            Mark::Allowed => self.is_allowed,
        })
    }

    /// Returns the signs of its marks.
    pub fn signs(self) -> String {
        self.marks().map(Mark::sign).collect()
    }
}
