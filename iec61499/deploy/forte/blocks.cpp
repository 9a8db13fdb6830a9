// Makes the block types of the module known to the 4diac FORTE into which this is built, of 2.0 or 3.0, whose
// development versions differ: versions.h finds out what they have when this is compiled.
//
// The values of a block that FORTE sees are copied to the state that the C functions work on before an event, and
// back whenever they issue one and at their end.

#include "module.h"
#include "versions.h"

#include <basicfb.h>
#include <resource.h>
#include <stringdict.h>
#include <typelib.h>

#include <forte_array.h>
#include <forte_bool.h>
#include <forte_byte.h>
#include <forte_dint.h>
#include <forte_dword.h>
#include <forte_int.h>
#include <forte_lint.h>
#include <forte_lreal.h>
#include <forte_lword.h>
#include <forte_real.h>
#include <forte_sint.h>
#include <forte_string.h>
#include <forte_time.h>
#include <forte_udint.h>
#include <forte_uint.h>
#include <forte_ulint.h>
#include <forte_usint.h>
#include <forte_word.h>

#include <memory>
#include <vector>

// what 3.0 has and 2.0 has not
#if __has_include(<inoutdataconn.h>)
#define DTWIN_FORTE 3
#include <forte_array_dynamic.h>
#include <genfb.h>
#else
#define DTWIN_FORTE 2
#endif

namespace {

using dtwin::Id;
using dtwin::idOf;

// ---- values ----

template<class Data, class Plain>
void put(CIEC_ANY &to, const TForteByte *from) {
  Plain value;
  memcpy(&value, from, sizeof value);
  static_cast<Data &>(to) = Data(static_cast<typename Data::TValueType>(value));
}

template<class Data, class Plain>
bool get(const CIEC_ANY &from, TForteByte *to) {
  const Plain value = static_cast<Plain>(static_cast<typename Data::TValueType>(static_cast<const Data &>(from)));
  memcpy(to, &value, sizeof value);
  return true;
}

void putTime(CIEC_ANY &to, const TForteByte *from) {
  int64_t value;
  memcpy(&value, from, sizeof value);
  static_cast<CIEC_TIME &>(to).setFromNanoSeconds(value);
}

bool getTime(const CIEC_ANY &from, TForteByte *to) {
  const int64_t value = static_cast<const CIEC_TIME &>(from).getInNanoSeconds();
  memcpy(to, &value, sizeof value);
  return true;
}

void putText(CIEC_ANY &to, const TForteByte *from) {
  fb_string value;
  memcpy(&value, from, sizeof value);
  static_cast<CIEC_STRING &>(to).assign(value.text, value.length);
}

bool getText(const CIEC_ANY &from, TForteByte *to) {
  const CIEC_STRING &text = static_cast<const CIEC_STRING &>(from);
  if(text.length() > FB_TEXT) {
    return false;
  }
#if DTWIN_FORTE == 3
  const char *start = text.c_str();
#else
  const char *start = text.getValue();
#endif
  fb_string value;
  value.length = text.length();
  memcpy(value.text, start, value.length);
  memcpy(to, &value, sizeof value);
  return true;
}

struct Converter {
  const char *type;
  size_t size;
  void (*put)(CIEC_ANY &to, const TForteByte *from);
  bool (*get)(const CIEC_ANY &from, TForteByte *to);
};

const Converter converters[] = {
  {"BOOL", sizeof(bool), put<CIEC_BOOL, bool>, get<CIEC_BOOL, bool>},
  {"SINT", 1, put<CIEC_SINT, int8_t>, get<CIEC_SINT, int8_t>},
  {"INT", 2, put<CIEC_INT, int16_t>, get<CIEC_INT, int16_t>},
  {"DINT", 4, put<CIEC_DINT, int32_t>, get<CIEC_DINT, int32_t>},
  {"LINT", 8, put<CIEC_LINT, int64_t>, get<CIEC_LINT, int64_t>},
  {"USINT", 1, put<CIEC_USINT, uint8_t>, get<CIEC_USINT, uint8_t>},
  {"UINT", 2, put<CIEC_UINT, uint16_t>, get<CIEC_UINT, uint16_t>},
  {"UDINT", 4, put<CIEC_UDINT, uint32_t>, get<CIEC_UDINT, uint32_t>},
  {"ULINT", 8, put<CIEC_ULINT, uint64_t>, get<CIEC_ULINT, uint64_t>},
  {"BYTE", 1, put<CIEC_BYTE, uint8_t>, get<CIEC_BYTE, uint8_t>},
  {"WORD", 2, put<CIEC_WORD, uint16_t>, get<CIEC_WORD, uint16_t>},
  {"DWORD", 4, put<CIEC_DWORD, uint32_t>, get<CIEC_DWORD, uint32_t>},
  {"LWORD", 8, put<CIEC_LWORD, uint64_t>, get<CIEC_LWORD, uint64_t>},
  {"REAL", sizeof(float), put<CIEC_REAL, float>, get<CIEC_REAL, float>},
  {"LREAL", sizeof(double), put<CIEC_LREAL, double>, get<CIEC_LREAL, double>},
  {"TIME", 8, putTime, getTime},
  {"STRING", sizeof(fb_string), putText, getText},
};

const Converter &converterOf(const char *type) {
  const Converter *found = converters;
  while(strcmp(found->type, type) != 0) {
    ++found;
  }
  return *found;
}

class Variable {
  public:
    explicit Variable(const dtwin_data &paData) : mData(paData), mConverter(converterOf(paData.type)) {
    }

    void store(CIEC_ANY &to, const TForteByte *state) const {
      if(mData.length == 0) {
        mConverter.put(to, state + mData.offset);
      }
      for(size_t k = 0; k < mData.length; ++k) {
        mConverter.put(element(to, k), state + mData.offset + k * mConverter.size);
      }
    }

    bool load(CIEC_ANY &from, TForteByte *state) const {
      bool fine = mData.length > 0 || mConverter.get(from, state + mData.offset);
      for(size_t k = 0; k < mData.length; ++k) {
        fine = mConverter.get(element(from, k), state + mData.offset + k * mConverter.size) && fine;
      }
      return fine;
    }

  private:
    CIEC_ANY &element(CIEC_ANY &array, size_t k) const {
#if DTWIN_FORTE == 3
      return static_cast<CIEC_ARRAY &>(array)[static_cast<intmax_t>(mData.lower) + static_cast<intmax_t>(k)];
#else
      return *static_cast<CIEC_ARRAY &>(array)[static_cast<TForteUInt16>(k)];
#endif
    }

    const dtwin_data &mData;
    const Converter &mConverter;
};

// ---- types ----

struct Events {
  std::vector<Id> names;
  std::vector<Id> types;
  std::vector<TDataIOID> numbers;
  std::vector<TForteInt16> starts;

  Events(const dtwin_event *events, size_t count) {
    for(size_t k = 0; k < count; ++k) {
      names.push_back(idOf(events[k].name));
      types.push_back(idOf(events[k].type));
      starts.push_back(events[k].with ? static_cast<TForteInt16>(numbers.size()) : static_cast<TForteInt16>(-1));
      for(const int16_t *data = events[k].with; data && *data >= 0; ++data) {
        numbers.push_back(static_cast<TDataIOID>(*data));
      }
      if(events[k].with) {
        numbers.push_back(CFunctionBlock::scmWithListDelimiter);
      }
    }
  }
};

struct Data {
  std::vector<Id> names;
  std::vector<Id> types;
  std::vector<Variable> variables;

  Data(const dtwin_data *data, size_t count) {
    for(size_t k = 0; k < count; ++k) {
      names.push_back(idOf(data[k].name));
      if(data[k].length) {
        types.push_back(idOf("ARRAY"));
#if DTWIN_FORTE == 3
        types.push_back(static_cast<Id>(data[k].lower));
        types.push_back(static_cast<Id>(data[k].lower + data[k].length - 1));
#else
        types.push_back(data[k].length);
#endif
      }
      types.push_back(idOf(data[k].type));
      variables.emplace_back(data[k]);
    }
  }
};

struct Type {
  const dtwin_type &code;
  Id name;
  Events eventInputs, eventOutputs;
  Data inputs, outputs, internals;
  SFBInterfaceSpec interface;
  SInternalVarsInformation internalVariables;

  explicit Type(const dtwin_type &paCode) :
      code(paCode), name(idOf(code.name)), eventInputs(code.event_inputs, code.event_input_count),
          eventOutputs(code.event_outputs, code.event_output_count), inputs(code.inputs, code.input_count),
          outputs(code.outputs, code.output_count), internals(code.internals, code.internal_count), interface(),
          internalVariables() {
#if DTWIN_FORTE == 3
    // by name, as the versions have them in different orders
    interface.mNumEIs = code.event_input_count;
    interface.mEINames = eventInputs.names.data();
    interface.mEIWith = eventInputs.numbers.data();
    interface.mEIWithIndexes = eventInputs.starts.data();
    interface.mNumEOs = code.event_output_count;
    interface.mEONames = eventOutputs.names.data();
    interface.mEOWith = eventOutputs.numbers.data();
    interface.mEOWithIndexes = eventOutputs.starts.data();
    interface.mNumDIs = code.input_count;
    interface.mDINames = inputs.names.data();
    interface.mDIDataTypeNames = inputs.types.data();
    interface.mNumDOs = code.output_count;
    interface.mDONames = outputs.names.data();
    interface.mDODataTypeNames = outputs.types.data();
    dtwin::setEventTypes(interface, eventInputs.types.data(), eventOutputs.types.data(), 0);
#else
    interface = {static_cast<TForteUInt8>(code.event_input_count), eventInputs.names.data(),
      eventInputs.numbers.data(), eventInputs.starts.data(), static_cast<TForteUInt8>(code.event_output_count),
      eventOutputs.names.data(), eventOutputs.numbers.data(), eventOutputs.starts.data(),
      static_cast<TForteUInt8>(code.input_count), inputs.names.data(), inputs.types.data(),
      static_cast<TForteUInt8>(code.output_count), outputs.names.data(), outputs.types.data(), 0, nullptr};
#endif
    internalVariables = {code.internal_count, internals.names.data(), internals.types.data()};
  }
};

// ---- blocks ----

#if DTWIN_FORTE == 3

using Container = forte::core::CFBContainer &;

class Base : public CGenFunctionBlock<CBasicFB> {
  public:
    Base(Id paName, const Type &paType, Container paContainer) :
        CGenFunctionBlock<CBasicFB>(paContainer, paType.interface, paName, &paType.internalVariables), mType(paType),
            mThread(nullptr) {
      getGenInterfaceSpec() = paType.interface;
      const Id *types = paType.internals.types.data();
      for(size_t k = 0; k < paType.code.internal_count; ++k) {
        TForteByte *nowhere = nullptr;
        mInternals.emplace_back(createDataPoint(types, nowhere));
      }
    }

  protected:
    CIEC_ANY *getVarInternal(size_t paNumber) override {
      return mInternals[paNumber].get();
    }

    void issue(uint16_t paOutput) {
      sendOutputEvent(paOutput, mThread);
    }

    virtual void run(TEventID paEvent) = 0;

    const Type &mType;

  private:
    void executeEvent(TEventID paEvent, CEventChainExecutionThread *const paThread) override {
      mThread = paThread;
      run(paEvent);
    }

    void readInputData(TEventID paEvent) override {
      for(const int16_t *data = mType.code.event_inputs[paEvent].with; data && *data >= 0; ++data) {
        const TPortId port = static_cast<TPortId>(*data);
        readData(port, *getDI(port), *getDIConUnchecked(port));
      }
    }

    void writeOutputData(TEventID paEvent) override {
      for(const int16_t *data = mType.code.event_outputs[paEvent].with; data && *data >= 0; ++data) {
        const TPortId port = static_cast<TPortId>(*data);
        writeData(port, *getDO(port), *getDOConUnchecked(port));
      }
    }

    bool createInterfaceSpec(const char *, SFBInterfaceSpec &) override {
      return false;
    }

    std::vector<std::unique_ptr<CIEC_ANY>> mInternals;
    CEventChainExecutionThread *mThread;
};

#else

using Container = CResource *;

// what the constructor of a block of FORTE fills
struct Memory {
  std::vector<TForteByte> connections, variables;

  explicit Memory(const dtwin_type &code) :
      connections(
          CFunctionBlock::genFBConnDataSize(code.event_output_count, code.input_count, code.output_count) + 1),
          variables(
              CBasicFB::genBasicFBVarsDataSize(code.input_count, code.output_count, code.internal_count) + 1) {
  }
};

class Base : private Memory, public CBasicFB {
  public:
    Base(Id paName, const Type &paType, Container paContainer) :
        Memory(paType.code),
            CBasicFB(paContainer, &paType.interface, paName, &paType.internalVariables, connections.data(),
                variables.data()), mType(paType), mECCState(m_nECCState) {
    }

  protected:
    void issue(uint16_t paOutput) {
      sendOutputEvent(paOutput);
    }

    virtual void run(uint16_t paEvent) = 0;

    const Type &mType;
    CIEC_UINT &mECCState;

  private:
    void executeEvent(int paEvent) override {
      run(static_cast<uint16_t>(paEvent));
    }
};

#endif

class Block : public Base {
  public:
    Block(Id paName, const Type &paType, Container paContainer) :
        Base(paName, paType, paContainer), mState(paType.code.size) {
#if DTWIN_FORTE == 2
      setInitialValues();
#endif
    }

#if DTWIN_FORTE == 3
    bool initialize() override {
      const bool fine = Base::initialize();
      setInitialValues();
      return fine;
    }
#endif

    Id getFBTypeId() const override {
      return mType.name;
    }

  private:
    void setInitialValues() override {
      memcpy(mState.data(), mType.code.initial, mType.code.size);
      store();
    }

#if DTWIN_FORTE == 3
    void run(TEventID paEvent) override {
#else
    void run(uint16_t paEvent) override {
#endif
      if(paEvent >= mType.code.event_input_count) {
        return;
      }
      if(!load()) {
        DEVLOG_ERROR("%s: a text is longer than %d bytes\n", getInstanceName(), FB_TEXT);
        return;
      }
      dtwin_execution execution;
      memset(&execution.run.fault, 0, sizeof execution.run.fault);
      execution.run.iterations = FB_ITERATIONS;
      execution.run.head = execution.run.waiting = 0;
      execution.block = this;
      execution.issue = [](void *block, uint16_t output) {
        static_cast<Block *>(block)->store();
        static_cast<Block *>(block)->issue(output);
      };
      mType.code.execute(mState.data(), &execution.run, static_cast<uint16_t>(paEvent));
      store();
      if(!fb_fine(&execution.run)) {
        report(execution.run.fault);
      }
    }

    bool load() {
      bool fine = true;
      for(size_t k = 0; k < mType.inputs.variables.size(); ++k) {
        fine = mType.inputs.variables[k].load(*getDI(static_cast<TPortId>(k)), mState.data()) && fine;
      }
      for(size_t k = 0; k < mType.outputs.variables.size(); ++k) {
        fine = mType.outputs.variables[k].load(*getDO(static_cast<TPortId>(k)), mState.data()) && fine;
      }
      for(size_t k = 0; k < mType.internals.variables.size(); ++k) {
        fine = mType.internals.variables[k].load(*getVarInternal(static_cast<TPortId>(k)), mState.data()) && fine;
      }
      return fine;
    }

    void store() {
      for(size_t k = 0; k < mType.inputs.variables.size(); ++k) {
        mType.inputs.variables[k].store(*getDI(static_cast<TPortId>(k)), mState.data());
      }
      for(size_t k = 0; k < mType.outputs.variables.size(); ++k) {
        mType.outputs.variables[k].store(*getDO(static_cast<TPortId>(k)), mState.data());
      }
      for(size_t k = 0; k < mType.internals.variables.size(); ++k) {
        mType.internals.variables[k].store(*getVarInternal(static_cast<TPortId>(k)), mState.data());
      }
      if(mType.code.chart < mType.code.size) {
        int32_t state;
        memcpy(&state, mState.data() + mType.code.chart, sizeof state);
        mECCState = static_cast<TForteUInt16>(state);
      }
    }

    void report(const fb_fault &fault) {
      static const char *const problems[] = {"", "an index out of range", "a loop that does not end", "FOR ... BY 0",
        "a text that is too long", "a chart that never comes to rest"};
      const fb_place &place = mType.code.places[fault.place];
      const char *problem = fault.problem <= FB_ENDLESS_CHART ? problems[fault.problem] : "an error";
      DEVLOG_ERROR("%s: %s:%d:%d: %s\n", getInstanceName(), place.file, static_cast<int>(place.line),
          static_cast<int>(place.column), problem);
    }

    std::vector<TForteByte> mState;
};

class Entry : public CTypeLib::CFBTypeEntry {
  public:
    explicit Entry(const Type &paType) : CTypeLib::CFBTypeEntry(paType.name, nullptr, &paType.interface), mType(paType) {
    }

    CFunctionBlock *createFBInstance(Id paName, Container paContainer) override {
      return new Block(paName, mType, paContainer);
    }

  private:
    const Type &mType;
};

class Module {
  public:
    Module() {
      for(const dtwin_type *const *type = DTWIN_MODULE; *type; ++type) {
        mTypes.emplace_back(new Type(**type));
        mEntries.emplace_back(new Entry(*mTypes.back()));
      }
    }

  private:
    std::vector<std::unique_ptr<Type>> mTypes;
    std::vector<std::unique_ptr<Entry>> mEntries;
};

const Module module;

} // namespace
