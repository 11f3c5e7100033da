// The state of a differential equation: N numbers, or N vectors with one simulation a lane.
#ifndef VGROOVE_PLANT_NUMERIC_STATE_VECTOR_HPP
#define VGROOVE_PLANT_NUMERIC_STATE_VECTOR_HPP

namespace vgroove {

template <class V, int N> struct State { V x[static_cast<unsigned>(N)]; };

}  // namespace vgroove

#endif
