"""The composition root of `autonomy serve`: one vehicle, one web side, one mission after another.

The service waits for its vehicle, looks at it while it rests, flies what is queued, and waits
anew when it is gone. Everything that moves the vehicle happens in one event loop; the web side
has a thread of its own and can only leave orders in the station.

Frame: the first mission of a vehicle is armed at the origin of the service's frame, and the fence
and every goal are in that frame. Later missions begin where the vehicle landed; the pilot's frame
begins there, so fence and goals are shifted for it, and what it says is shifted back.

Rooms: `composition` puts everything together, `service` is the loop, `attending` looks after a
vehicle at rest, `missions` flies one mission, `restart` finds a vehicle in the air, `desk` turns
orders into missions, `watch` hears every tick, `parts` is what all of them work with,
`preparing` loads what flies, `memory` gives back what starting needed.
"""
