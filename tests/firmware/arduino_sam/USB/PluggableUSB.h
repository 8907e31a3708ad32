// The interface of a USB module, as the core declares it; the stand-in enumerates nothing.
#ifndef PUSB_h
#define PUSB_h

#include <Arduino.h>

struct USBSetup;

class PluggableUSBModule {
 public:
  PluggableUSBModule(uint8_t, uint8_t, uint32_t*) {}

 protected:
  virtual bool setup(USBSetup& setup) = 0;
  virtual int getInterface(uint8_t* interfaceCount) = 0;
  virtual int getDescriptor(USBSetup& setup) = 0;
  virtual uint8_t getShortName(char* name) = 0;

  friend class PluggableUSB_;
};

class PluggableUSB_ {
 public:
  bool plug(PluggableUSBModule* node) {
    node_ = node;
    return true;
  }
  // The serial number, ended by a zero.
  void getShortName(char* name) { name[node_ == nullptr ? 0 : node_->getShortName(name)] = 0; }

 private:
  PluggableUSBModule* node_;
};

PluggableUSB_& PluggableUSB();

#endif
