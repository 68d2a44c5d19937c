//! A campaign file and a truth model in, flight logs out: what a flight-test team would bring home.

mod atmosphere;
mod campaign;
mod check;
mod input;
mod random;
mod recorder;
mod settings;
mod timeline;
mod trim;
mod truth;
mod write;

pub use campaign::{Campaign, Flown};
pub use check::{Interface, check};
pub use input::Shape;
pub use random::Stream;
pub use recorder::{FieldLog, Recording, SensorError, TopicLog, record};
pub use settings::{
    Companion, Drive, Event, Flight, Gap, Maneuver, Point, Sensor, Settings, Timing, Topic,
};
pub use timeline::{Placed, Timeline};
pub use truth::{Signal, Truth};
pub use write::{write_log, write_truth};
