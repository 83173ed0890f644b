//! Reads a bus over Zenoh: `cargo run -- ENDPOINT`, by default `tcp/127.0.0.1:7447`, the daemon of
//! this machine. From another machine it needs a daemon with `gateway.anonymous_reading` and an
//! address in `gateway.listen` that the network reaches, such as `tcp/cell4:7447`, or `tls/…` and the
//! identity of a user in the configuration (docs/zenoh.md).
//!
//! It finds the buses in reach, reads the vendor ID of slave 0 of the first one (object 0x1018:01),
//! and prints three values as they come.

use std::env;

use rmpv::Value;
use zenoh::bytes::ZBytes;
use zenoh::{Config, Result, Session, Wait};

const SHOWN: usize = 3;

/// One field of the map that each payload of ecatd is.
fn field(payload: &ZBytes, name: &str) -> Option<Value> {
    let bytes = payload.to_bytes();
    let content = rmpv::decode::read_value(&mut bytes.as_ref()).ok()?;
    let fields = content.as_map()?;
    let (_, value) = fields.iter().find(|(key, _)| key.as_str() == Some(name))?;
    Some(value.clone())
}

/// The beginning of the keys of each bus in reach.
fn find(session: &Session) -> Result<Vec<String>> {
    let mut buses = Vec::new();
    let replies = session.liveliness().get("ecat/v1/*/alive").wait()?;
    while let Ok(reply) = replies.recv() {
        if let Ok(sample) = reply.result() {
            if let Some(bus) = sample.key_expr().as_str().strip_suffix("/alive") {
                buses.push(bus.to_string());
            }
        }
    }
    Ok(buses)
}

/// Reads an object, and prints its bytes, or why it cannot be read.
fn read_object(session: &Session, bus: &str, slave: u32, index: u16, subindex: u8) -> Result<()> {
    let key = format!("{bus}/ro/sdo/{slave}/{index}/{subindex}");
    let replies = session.get(key.as_str()).wait()?;
    while let Ok(reply) = replies.recv() {
        match reply.result() {
            Ok(sample) => match field(sample.payload(), "data") {
                Some(Value::Binary(data)) => println!("{key}: {data:02x?}"),
                _ => println!("{key}: an answer without data"),
            },
            Err(error) => match field(error.payload(), "error") {
                Some(text) => println!("{key}: {text}"),
                None => println!("{key}: nobody answers"),
            },
        }
    }
    Ok(())
}

/// Prints values of the process data as they are published.
fn watch(session: &Session, bus: &str) -> Result<()> {
    let key = format!("{bus}/ro/pdo/**");
    let subscriber = session.declare_subscriber(key.as_str()).wait()?;
    for _ in 0..SHOWN {
        let sample = subscriber.recv()?;
        if let Some(value) = field(sample.payload(), "value") {
            println!("{}: {value}", sample.key_expr());
        }
    }
    Ok(())
}

fn main() -> Result<()> {
    let endpoint = env::args().nth(1).unwrap_or_else(|| "tcp/127.0.0.1:7447".into());
    let mut config = Config::default();
    config.insert_json5("mode", "\"client\"")?;
    config.insert_json5("connect/endpoints", &format!("[\"{endpoint}\"]"))?;
    let session = zenoh::open(config).wait()?;
    let buses = find(&session)?;
    println!("buses: {}", buses.join(" "));
    if let Some(bus) = buses.first() {
        read_object(&session, bus, 0, 0x1018, 1)?;
        watch(&session, bus)?;
    }
    session.close().wait()
}
