//! The two macros with which effects are declared.

/// Declares an effect: its struct, and its catalogue entry.
///
/// ```text
/// effect! {
///     /// What it is, equation, source.
///     RowTemporalNoise, "row-temporal-noise", Voltage, Temporal, Pixel {
///         /// Standard deviation over frames of a row's offset
///         sigma_e: "e-", 0.0..=1e4;
///     }
/// }
/// ```
///
/// After the name come its [`Domain`](crate::effects::Domain), its
/// [`Class`](crate::effects::Class) and what it reads ([`Needs`](crate::effects::Needs)).
macro_rules! effect {
    (
        $(#[doc = $doc:literal])+
        $name:ident, $kind:literal, $domain:ident, $class:ident, $needs:ident {
            $(
                $(#[doc = $pdoc:literal])+
                $key:ident: $unit:literal, $min:literal..=$max:literal
                $(, default $default:literal)?;
            )*
        }
    ) => {
        $(#[doc = $doc])+
        #[derive(Clone, Copy, Debug, PartialEq)]
        pub struct $name {
            $(
                $(#[doc = $pdoc])+
                #[doc = concat!("(", $unit, ").")]
                pub $key: f32,
            )*
        }

        impl $name {
            /// This effect's entry, without its number in the catalogue.
            pub const ENTRY: $crate::effects::Entry = $crate::effects::Entry {
                id: 0,
                kind: $kind,
                doc: $crate::effects::text(concat!($($doc, "\n"),+)),
                domain: $crate::effects::Domain::$domain,
                class: $crate::effects::Class::$class,
                needs: $crate::effects::Needs::$needs,
                parameters: &[$(
                    $crate::effects::Parameter {
                        key: stringify!($key),
                        unit: $unit,
                        doc: $crate::effects::text(concat!($($pdoc),+)),
                        min: $min,
                        max: $max,
                        default: effect!(@default $($default)?),
                    },
                )*],
            };

            /// The effect with its parameters in the order of the entry; those that are missing have
            /// their defaults.
            #[allow(unused_mut, unused_variables)]
            pub fn from_values(values: &[f32]) -> Self {
                let mut values = values.iter().copied();
                Self {
                    $($key: values.next().or(effect!(@default $($default)?)).unwrap_or(0.0),)*
                }
            }

            /// The parameters in the order of the entry.
            pub fn values(&self) -> heapless::Vec<f32, { $crate::effects::MAX_PARAMETERS }> {
                [$(self.$key),*].iter().copied().collect()
            }
        }
    };
    (@default) => { None };
    (@default $default:literal) => { Some($default) };
}

/// Declares the catalogue: the modules, the enum [`Effect`](crate::effects::Effect) and its
/// dispatch. An effect with `if "FEATURE"` is compiled with that feature of the crate only. Numbers
/// that do not rise, as where one is taken twice, and a feature that is not the effect's name do
/// not compile.
macro_rules! catalogue {
    ($($id:literal => $module:ident::$name:ident $(if $feature:literal)?,)+) => {
        $($(#[cfg(feature = $feature)])? pub mod $module;)+

        const _: () = assert!(
            $crate::effects::declare::rises(&[$($id),+]),
            "an effect's number must be above all before it: none is used twice"
        );
        $(
            $(#[cfg(feature = $feature)])?
            const _: () = assert!(
                $module::$name::ENTRY.parameters.len() <= MAX_PARAMETERS,
                "an effect has MAX_PARAMETERS parameters at most"
            );
        )+
        $($(
            #[cfg(feature = $feature)]
            const _: () = assert!(
                $crate::effects::declare::same($module::$name::ENTRY.kind, $feature),
                "the feature of an effect has its name"
            );
        )?)+

        /// Any effect of the catalogue. Releases and features add variants, so that a `match`
        /// needs an arm for the others.
        #[derive(Clone, Copy, Debug, PartialEq)]
        #[non_exhaustive]
        #[allow(missing_docs)]
        pub enum Effect { $($(#[cfg(feature = $feature)])? $name($module::$name),)+ }

        impl Effect {
            /// The effects that are compiled in, in the order of their numbers.
            pub const CATALOGUE: &'static [Entry] =
                &[$($(#[cfg(feature = $feature)])? Entry { id: $id, ..$module::$name::ENTRY },)+];

            /// Its entry in the catalogue.
            pub const fn entry(&self) -> &'static Entry {
                match self {
                    $(
                        $(#[cfg(feature = $feature)])?
                        Effect::$name(_) => const { &Entry { id: $id, ..$module::$name::ENTRY } },
                    )+
                }
            }

            /// The effect with this number and these values, in the order and units of its entry's
            /// parameters, where the last may be left out that have defaults. `None` if it is not
            /// compiled in, or a value is missing or out of range.
            pub fn new(id: u8, values: &[f32]) -> Option<Self> {
                let entry = Self::CATALOGUE.iter().find(|e| e.id == id)?;
                let rest = entry.parameters.get(values.len()..)?;
                let fits = rest.iter().all(|p| p.default.is_some())
                    && values.iter().zip(entry.parameters).all(|(v, p)| p.accepts(*v));
                match id {
                    $(
                        $(#[cfg(feature = $feature)])?
                        $id if fits => Some($module::$name::from_values(values).into()),
                    )+
                    _ => None,
                }
            }

            /// Its parameters in the order of the entry.
            pub fn values(&self) -> heapless::Vec<f32, MAX_PARAMETERS> {
                match self { $($(#[cfg(feature = $feature)])? Effect::$name(e) => e.values(),)+ }
            }

            /// Runs [`Stage::prepare`].
            pub(crate) fn prepare(&self, cx: &mut Context<'_>) {
                match self {
                    $($(#[cfg(feature = $feature)])? Effect::$name(e) => e.prepare(cx),)+
                }
            }

            /// Runs a stage in the range of its domain.
            #[inline(always)]
            pub(crate) fn apply<A: Arith>(
                &self,
                cx: &Context<'_>,
                inputs: &Inputs<'_, A::Signal>,
                row: &mut [Block<A::Signal>],
            ) {
                match self {
                    $(
                        $(#[cfg(feature = $feature)])?
                        Effect::$name(e) => {
                            if const { $module::$name::ENTRY.domain.is_of_light() } {
                                e.apply::<A::Light>(cx, inputs, row);
                            } else {
                                e.apply::<A>(cx, inputs, row);
                            }
                        }
                    )+
                }
            }
        }

        $(
            $(#[cfg(feature = $feature)])?
            impl From<$module::$name> for Effect {
                fn from(effect: $module::$name) -> Self {
                    Effect::$name(effect)
                }
            }
        )+
    };
}

pub(crate) use {catalogue, effect};

/// Whether each number is above the one before it, the first above 0.
pub(super) const fn rises(numbers: &[u8]) -> bool {
    let (mut before, mut i) = (0, 0);
    while i < numbers.len() {
        if numbers[i] <= before {
            return false;
        }
        before = numbers[i];
        i += 1;
    }
    true
}

/// Whether two names are the same.
pub(super) const fn same(a: &str, b: &str) -> bool {
    let (a, b) = (a.as_bytes(), b.as_bytes());
    let mut i = 0;
    while i < a.len() && i < b.len() && a[i] == b[i] {
        i += 1;
    }
    i == a.len() && i == b.len()
}
