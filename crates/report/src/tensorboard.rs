//! The log of a training as a TensorBoard event file.
//!
//! The file is a sequence of records as in TFRecord; each is a message `Event` of TensorFlow's `event.proto`
//! (<https://github.com/tensorflow/tensorboard>, `tensorboard/compat/proto`), of which only scalars are used
//! here.

use prost::{Message, Oneof};
use reactsim_formats::tf_record;
use reactsim_nn::training::Row;

/// Name of the event file; TensorBoard recognises its beginning.
pub const EVENTS: &str = "events.out.tfevents.0.reactsim";
/// Version of event files.
const FILE_VERSION: &str = "brain.Event:2";

#[derive(Clone, PartialEq, Message)]
struct Event {
    #[prost(double, tag = "1")]
    wall_time: f64,
    #[prost(int64, tag = "2")]
    step: i64,
    #[prost(oneof = "What", tags = "3, 5")]
    what: Option<What>,
}

#[derive(Clone, PartialEq, Oneof)]
enum What {
    #[prost(string, tag = "3")]
    FileVersion(String),
    #[prost(message, tag = "5")]
    Summary(Summary),
}

#[derive(Clone, PartialEq, Message)]
struct Summary {
    #[prost(message, repeated, tag = "1")]
    value: Vec<Value>,
}

#[derive(Clone, PartialEq, Message)]
struct Value {
    #[prost(string, tag = "1")]
    tag: String,
    #[prost(float, tag = "2")]
    simple_value: f32,
}

/// Returns the first record of an event file.
pub fn header() -> Vec<u8> {
    let what = Some(What::FileVersion(FILE_VERSION.to_owned()));
    tf_record(&Event { wall_time: 0.0, step: 0, what }.encode_to_vec())
}

/// Returns the record of a row of the log. Tags are `train/…`, `validation/…` and `closed_loop/…`; wall times
/// are seconds since the training began.
pub fn record(row: &Row) -> Vec<u8> {
    let mut value = Vec::new();
    let mut put = |group: &str, name: &str, number: f64| {
        value.push(Value { tag: format!("{group}/{name}"), simple_value: number as f32 });
    };
    let wall = match row {
        Row::Step(row) => {
            row.loss.into_iter().for_each(|loss| put("train", "loss", loss));
            put("train", "learning_rate", row.learning_rate);
            put("train", "gradient_norm", row.gradient_norm);
            row.metrics.iter().for_each(|(name, number)| put("train", name, *number));
            put("train", "scenarios_per_second", row.wall.per_second);
            put("train", "memory_bytes", row.wall.memory as f64);
            row.wall
        }
        Row::Validation(row) => {
            put("validation", "loss", row.loss);
            row.metrics.iter().for_each(|(name, number)| put("validation", name, *number));
            row.closed_loop.iter().for_each(|(name, number)| put("closed_loop", name, *number));
            row.wall
        }
    };
    let what = Some(What::Summary(Summary { value }));
    tf_record(&Event { wall_time: wall.seconds, step: row.step() as i64, what }.encode_to_vec())
}

#[cfg(test)]
mod tests {
    use reactsim_nn::training::{StepRow, Wall};

    use super::*;

    /// Bytes written down from the definition of the messages and of the records.
    #[test]
    fn records_have_the_published_layout() {
        let header = header();
        let payload = b"\x09\0\0\0\0\0\0\0\0\x1a\x0dbrain.Event:2";
        assert_eq!(header[..8], (payload[9..].len() as u64).to_le_bytes());
        assert_eq!(header[12..header.len() - 4], payload[9..]);
        let row = Row::Step(StepRow {
            step: 3,
            epoch: 0.5,
            loss: Some(1.5),
            learning_rate: 0.25,
            gradient_norm: 2.0,
            items: 1.0,
            samples: 1,
            metrics: [("accuracy".to_owned(), 0.75)].into(),
            wall: Wall { seconds: 2.0, per_second: 4.0, memory: 1024 },
        });
        let record = record(&row);
        let event = Event::decode(&record[12..record.len() - 4]).unwrap();
        assert_eq!((event.wall_time, event.step), (2.0, 3));
        let Some(What::Summary(summary)) = event.what else { panic!("{event:?}") };
        let found: Vec<(&str, f32)> =
            summary.value.iter().map(|v| (v.tag.as_str(), v.simple_value)).collect();
        let expected = [
            ("train/loss", 1.5),
            ("train/learning_rate", 0.25),
            ("train/gradient_norm", 2.0),
            ("train/accuracy", 0.75),
            ("train/scenarios_per_second", 4.0),
            ("train/memory_bytes", 1024.0),
        ];
        assert_eq!(found, expected);
    }
}
