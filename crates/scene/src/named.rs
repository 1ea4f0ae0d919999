//! Enums whose values have names.

/// Defines an enum whose values have names: a constant `ALL`, in the order of the definition; a function that
/// returns the name of a value; and, if the name of one is given, a function that returns the value with a
/// name.
#[macro_export]
macro_rules! named_enum {
    (
        $name:ident $(, $from:ident)?;
        $(#[$meta:meta])*
        pub enum $type:ident { $($(#[$item_meta:meta])* $item:ident = $text:literal),+ $(,)? }
    ) => {
        $(#[$meta])*
        pub enum $type { $($(#[$item_meta])* $item),+ }

        impl $type {
            /// All values, in the order of their definition.
            pub const ALL: [Self; [$($text),+].len()] = [$(Self::$item),+];

            /// Returns the name used in files, messages and on the command line.
            pub const fn $name(self) -> &'static str {
                match self {
                    $(Self::$item => $text),+
                }
            }

            $(
                /// Returns the value with this name.
                pub fn $from(name: &str) -> Option<Self> {
                    Self::ALL.into_iter().find(|value| value.$name() == name)
                }
            )?
        }
    };
}
