// What differs among the development versions of FORTE. Of two functions of a name the one with an int is taken
// where it can be compiled, else that with a long.
#ifndef DTWIN_VERSIONS_H
#define DTWIN_VERSIONS_H

#include <funcbloc.h>
#include <stringdict.h>

namespace dtwin {

using Id = CStringDictionary::TStringId;

template<class Dictionary>
auto inserted(const char *text, int) -> decltype(Dictionary::getInstance().insert(text)) {
  return Dictionary::getInstance().insert(text);
}

// since 2025 the dictionary has no instance
template<class Dictionary>
Id inserted(const char *text, long) {
  return Dictionary::insert(text);
}

inline Id idOf(const char *text) {
  return inserted<CStringDictionary>(text, 0);
}

// since 2025 an interface has the types of its events, which E_TRIG looks at
template<class Interface>
auto setEventTypes(Interface &interface, const Id *inputs, const Id *outputs, int)
    -> decltype(interface.mEITypeNames = inputs, interface.mEOTypeNames = outputs, void()) {
  interface.mEITypeNames = inputs;
  interface.mEOTypeNames = outputs;
}

template<class Interface>
void setEventTypes(Interface &, const Id *, const Id *, long) {
}

} // namespace dtwin

#endif
